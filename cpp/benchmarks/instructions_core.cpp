// What the core's operations cost in instructions, which CI holds to cpp/benchmarks/instruction_limits.txt.

#include "operations.hpp"
#include "run_operation.hpp"

int main(int argc, char** argv) { return elliptude::operations::run_operation(elliptude::operations::all, argc, argv); }
