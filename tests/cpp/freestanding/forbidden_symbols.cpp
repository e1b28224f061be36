// Does what the core must not do, so that a test can show that check_symbols.cmake finds it.
#include <cmath>
#include <cstdlib>
#include <vector>

int* operator_new() { return new int[3]; }
void operator_delete(const int* p) { delete p; }
void* c_malloc(std::size_t size) { return std::malloc(size); }
void c_free(void* p) { std::free(p); }
void standard_library_throw(std::vector<int>& v, std::size_t size) { v.reserve(size); }
int locked_static(int first) {
  static int value = first;
  return value;
}
double exponential(double x) { return std::exp(x); }
float sine(float x) { return std::sin(x); }
long double angle(long double y, long double x) { return std::atan2(y, x); }
