/// Guaranteed fusion: what satisfies a prediction and many quadrics is in the set, which is no larger than the prediction; and
/// two ellipsoids, or one and a quadric, whose set holds a common point.

#include <Eigen/Eigenvalues>

#include "fuzz.hpp"

namespace elliptude::fuzz {

template <int N>
using RealN = Eigen::Matrix<Real, N, 1>;

/// yᵀAy + 2gᵀy, and the sum of the magnitudes of its terms.
template <int N>
Real value_at(const Quadric<double, N>& quadric, const RealN<N>& y, Real& magnitude) {
  const Eigen::Matrix<Real, N, N> a = quadric.a.template cast<Real>();
  const RealN<N> g = quadric.g.template cast<Real>();
  magnitude = y.cwiseAbs().dot(a.cwiseAbs() * y.cwiseAbs()) + 2 * g.cwiseAbs().dot(y.cwiseAbs());
  return y.dot(a * y) + 2 * g.dot(y);
}

/// A quadric that holds a point, on its boundary or within: an ellipsoid, a cylinder, a slab, a half-space, or of any signs.
template <int N>
Quadric<double, N> honest_quadric(Bytes& bytes, const RealN<N>& point) {
  Quadric<double, N> quadric;
  const double scale = bytes.choice(3) == 0 ? bytes.between(1e-12, 1e12) : bytes.between(1e-2, 1e2);
  Eigen::Matrix<double, N, N> root;
  for (int i = 0; i < N * N; ++i) {
    root(i) = bytes.unit();
  }
  switch (bytes.choice(5)) {
    case 0:
      quadric.a = root * root.transpose();
      break;
    case 1:
      quadric.a = bytes.shape<N>(1e-4, 1);
      break;
    case 2:
      quadric.a = root.col(0) * root.col(0).transpose();
      break;
    case 3:
      quadric.a.setZero();
      break;
    default:
      quadric.a = root + root.transpose();
  }
  quadric.a = scale * (quadric.a + quadric.a.transpose().eval()) / 2;
  const double far = bytes.between(1e-6, 10);
  const RealN<N> middle = point + static_cast<Real>(far) * bytes.in_ball<N>();
  quadric.g = (-(quadric.a.template cast<Real>() * middle)).template cast<double>();
  if (bytes.choice(4) == 0) {
    quadric.g = scale * root.col(N - 1);
  }
  Real magnitude;
  const Real value = value_at<N>(quadric, point, magnitude);
  const Real slack =
      bytes.choice(2) == 0 ? Real(0) : static_cast<Real>(scale) * std::abs(static_cast<Real>(bytes.unit()));
  quadric.c = std::nextafter(static_cast<double>(value + slack), std::numeric_limits<double>::infinity());
  return quadric;
}

template <int N>
void require_contains(const Ellipsoid<double, N>& set, const RealN<N>& point, Real allowed, const char* what) {
  const RealN<N> error = point - set.center.template cast<Real>();
  const Real digits =
      4 * std::numeric_limits<Real>::epsilon() * (1 + point.norm() + set.center.template cast<Real>().norm());
  if (const Real excess = outside_by<N>(set.shape, error, digits); !(excess <= allowed)) {
    std::fprintf(stderr, "form %.9Lg\n", 1 + excess);
    show("point", point);
    show("center", set.center);
    show("shape", set.shape);
    broken("the truth is inside", what);
  }
}

template <int N>
SizeCriterion<double, N> size_criterion(Bytes& bytes) {
  switch (bytes.choice(3)) {
    case 0:
      return SizeCriterion<double, N>::trace();
    case 1:
      return SizeCriterion<double, N>::weighted_trace(bytes.shape<N>(1e-3, 1e3));
    default:
      return SizeCriterion<double, N>::volume();
  }
}

/// −∞ of what is not positive definite.
template <int N>
Real log_determinant(const Eigen::Matrix<double, N, N>& p) {
  const Eigen::LLT<Eigen::Matrix<Real, N, N>> factored(p.template cast<Real>());
  if (factored.info() != Eigen::Success) {
    return -std::numeric_limits<Real>::infinity();
  }
  const Eigen::Matrix<Real, N, N> l = factored.matrixL();
  return 2 * l.diagonal().array().log().sum();
}

/// What a fusion may say of true constraints without a set.
bool may_refuse_truth(Status status, bool with_prediction) {
  return status == Status::out_of_range ||
         (!with_prediction && (status == Status::unbounded || status == Status::beyond_domain));
}

/// \tparam Each `Quadric<double, N>` or, of six coordinates, `HalfQuadric<double>`.
template <int N, typename Each>
void many(Bytes& bytes) {
  Ellipsoid<double, N> predicted{Eigen::Matrix<double, N, 1>::Zero(), bytes.any_sized_shape<N>(1e-8, 10)};
  if (bytes.choice(3) == 0) {
    for (int i = 0; i < N; ++i) {
      predicted.center(i) = bytes.unit();
    }
  }
  bool honest = is_shape<N>(predicted.shape);
  const RealN<N> point =
      predicted.center.template cast<Real>() + (1 - Real(1e-15)) * point_of<N>(predicted.shape, bytes.in_ball<N>());
  const bool with_prediction = bytes.choice(4) != 0;
  const int count = bytes.choice(9);
  std::array<Each, 8> quadrics;
  for (int i = 0; i < count; ++i) {
    Each& quadric = quadrics[static_cast<std::size_t>(i)];
    if constexpr (std::is_same_v<Each, HalfQuadric<double>>) {
      quadric.half = bytes.choice(2) == 0 ? Half::first : Half::second;
      quadric.quadric = honest_quadric<3>(
          bytes, quadric.half == Half::first ? RealN<3>(point.template head<3>()) : RealN<3>(point.template tail<3>()));
      if (bytes.choice(8) == 0) {
        honest = false;
        quadric.quadric = {bytes.any_shape<3>(), bytes.numbers<3, 1>(), bytes.number()};
      }
    } else {
      quadric = honest_quadric<N>(bytes, point);
      if (bytes.choice(8) == 0) {
        honest = false;
        quadric = {bytes.any_shape<N>(), bytes.numbers<N, 1>(), bytes.number()};
      }
    }
  }
  if (bytes.choice(8) == 0) {
    honest = false;
    predicted = {bytes.numbers<N, 1>(), bytes.any_shape<N>()};
  }
  if (with_prediction && !is_shape<N>(predicted.shape) && predicted.shape.allFinite()) {
    return;  // what is nearly flat may be taken for an ellipsoid
  }
  const SizeCriterion<double, N> criterion = size_criterion<N>(bytes);
  QuadricFusion<double, N> fusion;
  fusion.set = predicted;
  const Snapshot before(fusion.set);
  const Status status = minimal_intersection(with_prediction ? &predicted : nullptr, quadrics.data(),
                                             static_cast<std::size_t>(count), criterion, fusion);
  if (status != Status::ok) {
    require(before.unchanged(), "nothing changed otherwise", "the set");
    require(status != Status::empty_intersection || fusion.margin < 0, "a contradiction has a margin", "many quadrics");
    if (honest && !may_refuse_truth(status, with_prediction)) {
      show("prediction", predicted.shape);
      for (int i = 0; i < count; ++i) {
        show("A", extended(quadrics[static_cast<std::size_t>(i)]).a);
        show("g", extended(quadrics[static_cast<std::size_t>(i)]).g);
        std::fprintf(stderr, "c %.17g\n", extended(quadrics[static_cast<std::size_t>(i)]).c);
      }
      broken("what is true is not refused", message(status));
    }
    return;
  }
  require_valid(fusion.set, "many quadrics");
  if (with_prediction && honest && criterion.kind == SizeCriterion<double, N>::Kind::volume) {
    // The core compares volumes by factors in double, each that of a shape as near as this: it counts where one is nearly flat.
    const double nearby = N * rounding::share<double>(rounding::cholesky(N));
    Eigen::Matrix<double, N, N> lowered = fusion.set.shape;
    lowered.diagonal() *= 1 - nearby;
    Eigen::Matrix<double, N, N> raised = predicted.shape;
    raised.diagonal() *= 1 + nearby;
    require(log_determinant<N>(lowered) <= log_determinant<N>(raised) + 1e-6L, "no larger than the prediction",
            "many quadrics");
  }
  if (honest) {
    require_contains<N>(fusion.set, point, 0, "many quadrics");
  }
}

/// How much one of two sets about nearly one center, both in the table of docs/domain.md, may be sharper than the other. In long
/// double: of a shape that is flat to rounding a calculated inverse in double may be small.
template <int N>
bool are_alike(const Ellipsoid<double, N>& first, const Ellipsoid<double, N>& second) {
  using Square = Eigen::Matrix<Real, N, N>;
  const auto least = [](const Ellipsoid<double, N>& set) {
    return Eigen::SelfAdjointEigenSolver<Square>(set.shape.template cast<Real>()).eigenvalues()(0);
  };
  const Real widest = first.shape.template cast<Real>().trace() + second.shape.template cast<Real>().trace();
  const Real thinnest = std::fmin(least(first), least(second));
  return thinnest > 0 && 2 * widest <= 1e7L * thinnest;
}

/// The sum T of the magnitudes of a quadric's terms on an ellipsoid about zero. (docs/domain.md)
template <int N>
Real terms_on(const Quadric<double, N>& quadric, const Ellipsoid<double, N>& ellipsoid) {
  const RealN<N> width = ellipsoid.shape.diagonal().template cast<Real>().cwiseSqrt();
  Real magnitude;
  static_cast<void>(value_at<N>(quadric, width, magnitude));
  return magnitude + std::abs(static_cast<Real>(quadric.c));
}

/// The condition of a shape after its diagonal is made one. (docs/domain.md)
template <int N>
Real condition(const Eigen::Matrix<double, N, N>& shape) {
  using Square = Eigen::Matrix<Real, N, N>;
  const RealN<N> inverse = shape.diagonal().template cast<Real>().cwiseSqrt().cwiseInverse();
  const Square scaled = inverse.asDiagonal() * shape.template cast<Real>() * inverse.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Square> eigen(scaled);
  const Real least = eigen.eigenvalues()(0);
  return least > 0 ? eigen.eigenvalues()(N - 1) / least : std::numeric_limits<Real>::infinity();
}

/// Whether the result is of the domain: N and A at the weight that was found, in long double. (docs/domain.md)
template <int N>
bool is_moderate(const Quadric<double, N>& quadric, const Ellipsoid<double, N>& ellipsoid, double share) {
  if (share == 1) {
    return true;  // the ellipsoid itself
  }
  using Square = Eigen::Matrix<Real, N, N>;
  const Real q = static_cast<Real>(share) / (1 - static_cast<Real>(share));
  const Square l = Eigen::LLT<Square>(ellipsoid.shape.template cast<Real>()).matrixL();
  const Square a = l.transpose() * quadric.a.template cast<Real>() * l + q * Square::Identity();
  const RealN<N> v = l.transpose() * quadric.g.template cast<Real>();
  const Eigen::SelfAdjointEigenSolver<Square> eigen(a);
  const RealN<N> seen = eigen.eigenvectors().transpose() * v;
  const Real level = static_cast<Real>(quadric.c) + q + (seen.cwiseAbs2().array() / eigen.eigenvalues().array()).sum();
  const Real least = std::fmin(eigen.eigenvalues()(0), level);
  return least > 0 && terms_on<N>(quadric, ellipsoid) + q <= 1e6L * least;
}

/// Two ellipsoids, or one with a quadric. These are of the first-order modes: sets are asked for always, common points in the
/// domain.
template <int N>
void two(Bytes& bytes) {
  constexpr Real digits = 1e-7L;
  Ellipsoid<double, N> first{Eigen::Matrix<double, N, 1>::Zero(), bytes.any_sized_shape<N>(1e-6, 10)};
  const RealN<N> point = (1 - digits) * point_of<N>(first.shape, bytes.in_ball<N>());
  Ellipsoid<double, N> second{Eigen::Matrix<double, N, 1>::Zero(), bytes.any_sized_shape<N>(1e-6, 10)};
  second.center = (point - (1 - digits) * point_of<N>(second.shape, bytes.in_ball<N>())).template cast<double>();
  bool honest = is_shape<N>(first.shape) && is_shape<N>(second.shape) &&
                outside_by<N>(second.shape, RealN<N>(point - second.center.template cast<Real>())) <= 0;
  if (bytes.choice(4) == 0) {
    honest = false;
    first = {bytes.numbers<N, 1>(), bytes.any_shape<N>()};
  }
  if (bytes.choice(8) == 0) {
    honest = false;
    second = {bytes.numbers<N, 1>(), bytes.any_shape<N>()};
  }
  const SizeCriterion<double, N> criterion = size_criterion<N>(bytes);
  Intersection<double, N> result{first, 0.25};
  const Snapshot before(result);
  const bool with_quadric = bytes.choice(2) == 0;
  const Quadric<double, N> quadric = honest_quadric<N>(bytes, point);
  const Status status = with_quadric ? minimal_intersection(quadric, first, criterion, result)
                                     : minimal_intersection(first, second, criterion, result);
  const bool alike = honest && are_alike<N>(first, second);
  Real ignored;
  const Real slack_at_point = static_cast<Real>(quadric.c) - value_at<N>(quadric, point, ignored);
  if (status != Status::ok) {
    require(before.unchanged(), "nothing changed otherwise", "two sets");
    const bool sure = with_quadric
                          ? condition<N>(first.shape) <= 1e8L && slack_at_point > 1e-6L * terms_on<N>(quadric, first)
                          : alike;
    require(!honest || status != Status::not_finite, "what is true is not refused", message(status));
    require(!(honest && sure) || status != Status::empty_intersection, "what is true is not refused", message(status));
    return;
  }
  require(validate(result.set) == Status::ok, "ok means finite and not negative", "two sets");
  require(result.share >= 0 && result.share <= 1, "a share is one", "two sets");
  if (honest) {
    require(is_shape<N>(result.set.shape) || result.set.shape.isZero(0), "ok means finite and positive definite",
            "two sets");
    const bool holds = with_quadric ? condition<N>(first.shape) <= 1e8L && condition<N>(result.set.shape) <= 1e8L &&
                                          is_moderate<N>(quadric, first, result.share)
                                    : alike;
    if (holds) {
      require_contains<N>(result.set, point, 1e-6L, with_quadric ? "an ellipsoid and a quadric" : "two ellipsoids");
    }
  }
  double margin = 0.25;
  const Status overlap = overlap_margin(first, second, margin);
  require(overlap == Status::ok || margin == 0.25, "nothing changed otherwise", "the margin");
  require(overlap != Status::ok || margin <= 1, "a margin is at most one", "the margin");
  require(!(honest && alike) || overlap != Status::ok || margin >= 0, "what is true is not refused", "the margin");
}

void session(Bytes bytes) {
  switch (bytes.choice(4)) {
    case 0:
      many<3, Quadric<double, 3>>(bytes);
      break;
    case 1:
      many<6, HalfQuadric<double>>(bytes);
      break;
    case 2:
      many<6, Quadric<double, 6>>(bytes);
      break;
    default:
      two<3>(bytes);
  }
}

}  // namespace elliptude::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  elliptude::fuzz::session({data, size});
  return 0;
}
