// Time per operation of the core, and of what a user would take instead, in one run.

#include "benchmark.hpp"
#include "operations.hpp"
#include "peers.hpp"

namespace {

[[maybe_unused]] const bool registered = elliptude::operations::register_all(elliptude::operations::all) &&
                                         elliptude::operations::register_all(elliptude::operations::peers::all);

}  // namespace
