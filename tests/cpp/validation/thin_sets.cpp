/// \file
/// Looks for true states outside of predicted sets that are thin: 1e-3 to 1e-8 times as thick as wide in double, 1e-1 to 3e-4 in
/// single precision, off all axes, attitude and rate mixed, after 1, 200 and 5000 predictions without a measurement, of a gyro
/// without errors, a free body and a pendulum. The truth starts on the boundary, at the ends of the thin axis among others. It
/// moves in long double, and is judged in 33 digits.

#include <cstdio>
#include <cstdlib>

#include "support/guaranteed.hpp"

namespace {

using namespace elliptude;
using namespace elliptude::testing;

__extension__ typedef __float128 Quad;  // NOLINT(modernize-use-using): only a typedef may be an extension

using Vector6q = std::array<Quad, 6>;
using Matrix6q = std::array<Vector6q, 6>;

Quad root(Quad x) {
  auto y = static_cast<Quad>(std::sqrt(static_cast<Real>(x)));
  for (int i = 0; i < 2; ++i) {
    y = (y + x / y) / 2;
  }
  return y;
}

/// \return whether P = LLᵀ.
bool factored(const Matrix6q& p, Matrix6q& l) {
  l = {};
  for (std::size_t j = 0; j < 6; ++j) {
    for (std::size_t i = j; i < 6; ++i) {
      Quad sum = p[i][j];
      for (std::size_t k = 0; k < j; ++k) {
        sum -= l[i][k] * l[j][k];
      }
      if (i == j && !(sum > 0)) {
        return false;
      }
      l[i][j] = i == j ? root(sum) : sum / l[j][j];
    }
  }
  return true;
}

Vector6q times(const Matrix6q& l, const Vector6q& u) {
  Vector6q y{};
  for (std::size_t i = 0; i < 6; ++i) {
    for (std::size_t k = 0; k <= i; ++k) {
      y[i] += l[i][k] * u[k];
    }
  }
  return y;
}

/// yᵀP⁻¹y with P = LLᵀ.
Quad form(const Matrix6q& l, const Vector6q& y) {
  Vector6q u = y;
  Quad sum = 0;
  for (std::size_t i = 0; i < 6; ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      u[i] -= l[i][k] * u[k];
    }
    u[i] /= l[i][i];
    sum += u[i] * u[i];
  }
  return sum;
}

template <typename Scalar>
Matrix6q exactly(const Matrix6<Scalar>& shape) {
  Matrix6q p;
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) {
      p[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)] = static_cast<Quad>(shape(i, j));
    }
  }
  return p;
}

Vector6q exactly(const RealVector6& vector) {
  Vector6q y;
  for (int i = 0; i < 6; ++i) {
    y[static_cast<std::size_t>(i)] = static_cast<Quad>(vector(i));
  }
  return y;
}

template <typename Scalar>
RealMatrix rotation_of(const Matrix3<Scalar>& attitude) {
  RealMatrix c = attitude.template cast<Real>();
  for (int i = 0; i < 5; ++i) {
    c = (c + RealMatrix(c.inverse().transpose())) / 2;
  }
  return c;
}

/// What was counted in one cell of the table.
struct Cell {
  long sets = 0;
  long truths = 0;
  long escapes = 0;
  long refused = 0;  ///< predictions that ended with an error
  long lost = 0;     ///< sets that have become too large to be bounded
  Quad worst = 0;
};

/// A set as thin as can be stored, and a truth on its boundary: at an end of the thin axis, or anywhere.
template <typename State>
struct Start {
  GibbsEllipsoid<State> set;
  std::array<Motion, 4> truths;

  Start(Random& random, double width, double ratio, const Eigen::Vector3d& vector) {
    using Scalar = StateScalar<State>;
    set.center = State{random.rotation().cast<Scalar>(), vector.cast<Scalar>()};
    const Eigen::Matrix<double, 6, 6> axes = random.orthogonal<6>();
    Eigen::Matrix<Real, 6, 1> lengths;
    for (int i = 0; i < 6; ++i) {
      lengths(i) = static_cast<Real>(width * std::pow(ratio, i == 0 ? 0 : i == 5 ? 1 : random.uniform(0, 1)));
    }
    const RealMatrix6 half = axes.cast<Real>() * lengths.asDiagonal();
    const Matrix6<Scalar> rounded = RealMatrix6(half * half.transpose()).cast<Scalar>();
    set.shape = (rounded + rounded.transpose()) / Scalar(2);
    Matrix6<Scalar> factor;
    Matrix6q l;
    while (cholesky(set.shape, factor) != Status::ok || !factored(exactly(set.shape), l)) {
      set.shape.diagonal() *= Scalar(1) + std::numeric_limits<Scalar>::epsilon();  // rounding has made it flat
    }
    for (std::size_t k = 0; k < truths.size(); ++k) {
      Vector6q y;
      const RealVector6 direction = axes.col(5).cast<Real>();
      Vector6q u;
      const RealVector6 anywhere = random.unit_vector<6>().cast<Real>();
      for (std::size_t i = 0; i < 6; ++i) {
        y[i] = static_cast<Quad>((k == 0 ? 1 : -1) * direction(static_cast<int>(i)));
        u[i] = static_cast<Quad>((1 - 1e-6L) * anywhere(static_cast<int>(i)));
      }
      if (k < 2) {
        const Quad scale = static_cast<Quad>(1 - 1e-6L) / root(form(l, y));
        for (Quad& entry : y) {
          entry *= scale;
        }
      } else {
        y = times(l, u);
      }
      RealVector6 error;
      for (int i = 0; i < 6; ++i) {
        error(i) = static_cast<Real>(y[static_cast<std::size_t>(i)]);
      }
      const RealVector g = error.head<3>() / 2;
      RealMatrix s;
      s << 0, -g(2), g(1), g(2), 0, -g(0), -g(1), g(0), 0;
      truths[k] = {rotation_of(set.center.attitude) *
                       RealMatrix(RealMatrix::Identity() + (2 / (1 + g.squaredNorm())) * (s + s * s)),
                   vector_part(set.center).template cast<Real>() + error.tail<3>()};
    }
  }
};

template <typename Filter>
void judge(const Filter& filter, const Motion& truth, Cell& cell) {
  const auto& set = filter.ellipsoid();
  const RealMatrix r = rotation_of(set.center.attitude).transpose() * truth.attitude;
  const Real scale = 2 / (1 + r.trace());
  const RealVector error = truth.angular_velocity - RealVector(vector_part(set.center).template cast<Real>());
  RealVector6 y;
  y << scale * (r(2, 1) - r(1, 2)), scale * (r(0, 2) - r(2, 0)), scale * (r(1, 0) - r(0, 1)), error;
  Matrix6q l;
  ++cell.truths;
  const bool is_set = factored(exactly(set.shape), l);
  const Quad value = is_set ? form(l, exactly(y)) : static_cast<Quad>(HUGE_VALL);
  cell.worst = value > cell.worst ? value : cell.worst;
  cell.escapes += value <= 1 ? 0 : 1;
}

/// Predicts step by step. \return whether there is a set at the end.
template <typename Flow>
bool predicted(const Flow& flow, const GibbsEllipsoid<typename Flow::State>& set, const typename Flow::Input& input,
               int steps, StateScalar<typename Flow::State> h, GuaranteedFilter<Flow>& filter, Cell& cell) {
  using Scalar = StateScalar<typename Flow::State>;
  ++cell.sets;
  if (GuaranteedFilter<Flow>::make(flow, {}, 0, filter) != Status::ok || filter.start(set) != Status::ok) {
    ++cell.refused;
    return false;
  }
  for (int k = 1; k <= steps; ++k) {
    if (filter.predict(static_cast<Scalar>(k) * h, input) != Status::ok) {
      ++cell.refused;
      return false;
    }
    if (!filter.knows_attitude()) {
      ++cell.lost;
      return false;
    }
  }
  return true;
}

/// A gyro without errors that shows one rate throughout: the attitude turns by exp(S(t(ω̃ − β))).
template <typename Scalar>
void try_gyro(Random& random, double ratio, int steps, Cell& cell) {
  using Flow = GuaranteedGyroFlow<Scalar>;
  const Start<GyroState<Scalar>> start(random, random.log_uniform(1e-3, steps > 1000 ? 0.1 : 0.3), ratio,
                                       random.in_ball<3>());
  const Scalar h = std::ldexp(Scalar(1), steps > 1000 ? -12 : -10);
  const Vector3<Scalar> rate = random.normal_matrix<3>().cast<Scalar>();
  Flow flow;
  GuaranteedFilter<Flow> filter;
  if (Flow::make({}, Flow::IntervalRate::mean, flow) != Status::ok) {
    std::abort();
  }
  if (!predicted(flow, start.set, {rate}, steps, h, filter, cell)) {
    return;
  }
  for (const Motion& before : start.truths) {
    const RealVector turn = Real(h) * steps * (rate.template cast<Real>() - before.angular_velocity);
    const RealMatrix by = Eigen::AngleAxis<Real>(turn.norm(), RealVector(turn / turn.norm())).toRotationMatrix();
    judge(filter, {before.attitude * by, before.angular_velocity}, cell);
  }
}

template <typename Scalar, typename Potential>
void try_body(Random& random, double ratio, int steps, const Potential& potential, const RealVector& moment,
              Cell& cell) {
  using Flow = GuaranteedRigidBodyFlow<Scalar, Potential>;
  // In single precision less is below what rounding does to the rate in a step (docs/domain.md).
  const bool is_single = std::numeric_limits<Scalar>::digits < 30;
  const Start<RigidBodyState<Scalar>> start(random, random.log_uniform(is_single ? 3e-3 : 1e-4, 3e-2), ratio,
                                            random.in_ball<3>());
  const Eigen::Vector3d masses(random.uniform(0.1, 1), random.uniform(0.1, 1), random.uniform(0.1, 1));
  const Vector3<Scalar> moments =
      Eigen::Vector3d(masses(1) + masses(2), masses(2) + masses(0), masses(0) + masses(1)).template cast<Scalar>();
  const Scalar h = std::ldexp(Scalar(1), steps > 1000 ? -12 : -10);
  RigidBody<Scalar> body;
  Flow flow;
  GuaranteedFilter<Flow> filter;
  if (RigidBody<Scalar>::make(moments.asDiagonal(), body) != Status::ok ||
      Flow::make(body, potential, h, {}, flow) != Status::ok) {
    std::abort();
  }
  if (!predicted(flow, start.set, {}, steps, h, filter, cell)) {
    return;
  }
  const RealMatrix inertia = moments.template cast<Real>().asDiagonal();
  const RealTorque torque = [&](const RealMatrix& attitude, Real /*time*/) {
    return RealVector(moment.cross(RealVector(attitude.row(2).transpose())));
  };
  for (const Motion& before : start.truths) {
    judge(filter, independent_flow(inertia, torque, before, 0, Real(h) * steps, 1 + steps / 100), cell);
  }
}

template <typename Scalar>
long try_all(const char* name, std::initializer_list<double> ratios, long sets, Random& random) {
  UniformGravity<Scalar> gravity;
  if (UniformGravity<Scalar>::make(1, 8, Eigen::Vector3d(0.0625, -0.125, 0.25).cast<Scalar>(), gravity) != Status::ok) {
    std::abort();
  }
  long faults = 0;
  for (const double ratio : ratios) {
    for (const int steps : {1, 200, 5000}) {
      std::array<Cell, 3> cells;
      for (long k = 0; k < (steps == 1 ? 20 * sets : sets); ++k) {
        try_gyro<Scalar>(random, ratio, steps, cells[0]);
        try_body<Scalar>(random, ratio, steps, FreeBody<Scalar>(), RealVector::Zero(), cells[1]);
        try_body<Scalar>(random, ratio, steps, gravity, RealVector(0.5L, -1, 2), cells[2]);
      }
      const std::array<const char*, 3> bodies{"gyro", "free", "pendulum"};
      for (std::size_t i = 0; i < 3; ++i) {
        const Cell& cell = cells[i];
        std::printf("%-7s %-9s %9.0e %6d %8ld %8ld %8ld %8ld %8ld   %.9Lg\n", name, bodies[i], ratio, steps, cell.sets,
                    cell.refused, cell.lost, cell.truths, cell.escapes, static_cast<Real>(cell.worst));
        faults += cell.refused + cell.escapes;
      }
    }
  }
  return faults;
}

}  // namespace

int main(int argc, char** argv) {
  const long sets = argc > 1 ? std::atol(argv[1]) : 100;
  const long seed = argc > 2 ? std::atol(argv[2]) : 1;
  if (sets < 1 || argc > 3) {
    std::fprintf(stderr, "usage: %s [SETS IN EACH ROW [SEED]]\n", argv[0]);
    return 2;
  }
  Random random(static_cast<std::uint64_t>(seed));
  std::printf("%-7s %-9s %9s %6s %8s %8s %8s %8s %8s   %s\n", "", "", "thin/wide", "steps", "sets", "refused", "lost",
              "truths", "escapes", "worst form");
  long faults = try_all<double>("double", {1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8}, sets, random);
  faults += try_all<float>("float", {1e-1, 1e-2, 1e-3, 3e-4}, sets, random);
  return faults == 0 ? 0 : 1;
}
