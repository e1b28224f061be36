// Prints the version if the library does what it should.
#include <cstdio>

#include <elliptude/base/so3.hpp>
#include <elliptude/version.hpp>

int main() {
  const Eigen::Vector3d zeta(0.1, -0.2, 0.3);
  const Eigen::Matrix3d rotation = elliptude::exp(zeta);
  const double error = (elliptude::log(rotation) - zeta).norm();
  if (!(error < 1e-15)) {
    std::fprintf(stderr, "log(exp(zeta)) is off by %g\n", error);
    return 1;
  }
  std::puts(elliptude::version_string);
  return 0;
}
