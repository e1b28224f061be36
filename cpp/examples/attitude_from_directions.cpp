// The attitude from directions that are known in reference axes and measured in body axes: Wahba's problem.

#include <cstdio>
#include <elliptude/attitude/wahba.hpp>

using elliptude::Status;

int main() {
  // One direction a column. They need not be of unit length: say the sun, the nadir and a magnetic field in any unit.
  Eigen::Matrix3d reference;
  reference.col(0) = Eigen::Vector3d(1, 0, 0);
  reference.col(1) = Eigen::Vector3d(0, 0.6, -0.8);
  reference.col(2) = Eigen::Vector3d(20, -5, 40);

  // What sensors on the body would see, with errors of about half a degree.
  const Eigen::Matrix3d truth = elliptude::exp(Eigen::Vector3d(0.5, -1.0, 0.8));  // body to reference
  Eigen::Matrix3d body = truth.transpose() * reference;
  body.col(0) = elliptude::exp(Eigen::Vector3d(0.00, 0.01, -0.01)) * body.col(0);
  body.col(1) = elliptude::exp(Eigen::Vector3d(0.01, 0.00, 0.01)) * body.col(1);
  body.col(2) = elliptude::exp(Eigen::Vector3d(-0.01, 0.01, 0.00)) * body.col(2);

  // Weights say how much a direction is trusted.
  const Eigen::Vector3d weights(1.0, 1.0, 0.5);

  elliptude::WahbaSolution<double> solution;
  const Status status = elliptude::solve_wahba(reference, body, weights, elliptude::WahbaMethod::svd, solution);
  if (status != Status::ok) {
    // `attitude_undetermined` where all directions are on one line.
    std::fprintf(stderr, "%s\n", elliptude::message(status));
    return 1;
  }

  const elliptude::Quaternion<double> q = elliptude::to_quaternion(solution.attitude);
  const Eigen::Vector3d error = elliptude::log(Eigen::Matrix3d(solution.attitude.transpose() * truth));
  std::printf("attitude, body to reference (qw qx qy qz): %.6f %.6f %.6f %.6f\n", q.w, q.vector.x(), q.vector.y(),
              q.vector.z());
  std::printf("cost %.3e, condition %.2f\n", solution.cost, solution.condition);
  std::printf("error of the attitude: %.4f rad\n", error.norm());
  return error.norm() < 0.02 ? 0 : 1;
}
