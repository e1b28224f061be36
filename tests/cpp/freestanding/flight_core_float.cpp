// The other half of flight_core.cpp, in a file of its own so that two processors can compile them.
#include "../support/every_function.hpp"

namespace elliptude::testing {

template Tally<float> use_every_function(const Seeds<float>&) noexcept;

}  // namespace elliptude::testing
