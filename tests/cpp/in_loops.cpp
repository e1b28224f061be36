/// The tests of what is written out, with loops in its place, as a flight program has them: also those that the filters
/// of same_bits do not need.

#define ELLIPTUDE_MOST_UNROLLED 0

#include "linear/test_factorization.cpp"
#include "sets/test_reduced_search.cpp"
