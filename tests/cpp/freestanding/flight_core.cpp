// The whole core, each function instantiated for double (and in flight_core_float.cpp for float), to be compiled with
// -fno-exceptions -fno-rtti and searched for symbols of the heap, of exceptions and of locks.
#include "../support/every_function.hpp"

namespace elliptude::testing {

template Tally<double> use_every_function(const Seeds<double>&) noexcept;

}  // namespace elliptude::testing

const char* flight_core_version() { return elliptude::version_string; }
