// What a user would take instead costs in instructions, for `make compare`. A program of its own: what the compiler
// inlines in one file depends on all that is in it.

#include "peers.hpp"
#include "run_operation.hpp"

int main(int argc, char** argv) {
  return elliptude::operations::run_operation(elliptude::operations::peers::all, argc, argv);
}
