#pragma once

/// \file
/// What one update leaves possible, for questions of one's own: each is answered with multipliers of its own, so that
/// the answer is sharper than what the filter's set says, which has to answer all questions at once.
/// (theory, section 16.12)

#include "elliptude/attitude/attitude_bounds.hpp"
#include "elliptude/guaranteed/detail/solution.hpp"
#include "elliptude/sets/projected_fusion.hpp"

namespace elliptude {

/// A set of attitudes by itself: C = center cay(γ/2) with γ in E(0, shape), rad².
template <typename Scalar>
struct AttitudeSet {
  Matrix3<Scalar> center;
  Matrix3<Scalar> shape;
};

/// The constraints of one update of a guaranteed filter, which `GuaranteedFilter::update` fills. What is asked of them
/// holds at the time of that update, on the same claim as the filter's set. They are 1.7 kB in `double` with
/// `ELLIPTUDE_MOST_QUESTIONED` 8.
template <typename State>
class UpdateConstraints {
 public:
  using Scalar = StateScalar<State>;
  using Set = GibbsEllipsoid<State>;

  /// A set as the only constraint, as where nothing else is kept.
  /// \param is_product whether its shape is of two sets, with zeros between (`GuaranteedSettings::estimates_vector`).
  [[nodiscard]] static UpdateConstraints of(const Set& set, bool is_product) noexcept {
    UpdateConstraints constraints;
    constraints.set_about(set.center, set.in_coordinates(), set, is_product);
    return constraints;
  }

  /// Whether the attitude is known; there is no answer otherwise.
  [[nodiscard]] bool knows_attitude() const noexcept { return knows_attitude_; }

  /// Where the turn about an axis may be from the center of the filter's set to the attitude, when what turns the axis
  /// is taken away by the shortest turn, rad, in the sense of a right-handed screw. A component of the error's rotation
  /// vector along the axis has the same bounds where these have zero between them.
  /// \param axis in the body axes at the center, of any length.
  /// \return `unbounded` without a set, or if rounding leaves no bound; `not_finite`; `zero_direction`.
  [[nodiscard]] Status turn_about(const Vector3<Scalar>& axis, Interval<Scalar>& angle) const noexcept {
    if (const Status status = checked(axis); status != Status::ok) {
      return status;
    }
    const Vector3<Scalar> n = scalar::unit(axis);
    return is_product_ ? answered<3>([&](const auto& asked) { return turn_of(asked, n, angle); })
                       : answered<6>([&](const auto& asked) { return turn_of(asked, n, angle); });
  }

  /// Where a component of the angular velocity, or of the gyro's bias, may be, rad/s.
  /// \param direction in body axes, of any length.
  /// \return `unbounded` without a set, or if rounding leaves no bound; `not_finite`; `zero_direction`.
  [[nodiscard]] Status vector_along(const Vector3<Scalar>& direction, Interval<Scalar>& extent) const noexcept {
    if (const Status status = checked(direction); status != Status::ok) {
      return status;
    }
    const Vector3<Scalar> n = scalar::unit(direction);
    Interval<Scalar> found;
    // Where the set is a product, the vector's set is one by itself.
    const Ellipsoid<Scalar, 3> vector = projection<3, 3>(set_);
    const Status status =
        is_product_ ? extent_along<Scalar, 3>(vector, nullptr, 0, n, found) : answered<6>([&](const auto& asked) {
          Vector6<Scalar> whole = Vector6<Scalar>::Zero();
          whole.template tail<3>() = n;
          return extent_along(asked.set, asked.quadrics.data(), asked.count, whole, found);
        });
    if (status != Status::ok) {
      return status;
    }
    const Vector3<Scalar> origin = vector_part(origin_);
    const Scalar middle = n.dot(origin);
    const Scalar slip = rounding::share<Scalar>(rounding::component) * n.cwiseAbs().dot(origin.cwiseAbs());
    const auto lost = [&slip](const Scalar& value) {
      return Scalar(slip + rounding::one_rounding<Scalar>() * scalar::abs(value));
    };
    const Scalar from = middle + found.least;
    const Scalar to = middle + found.most;
    extent = {from - lost(from), to + lost(to)};
    return Status::ok;
  }

  /// A small set of the attitude alone, from all constraints, and from slabs about where the turns about its own axes
  /// may be: never larger by the criterion than the attitude's part of what the filter fused.
  /// \return `unbounded` without a set, or of one that may hold half turns about its own center; the status of
  /// `validate` for the criterion.
  [[nodiscard]] Status attitude_set(const SizeCriterion<Scalar, 3>& criterion,
                                    AttitudeSet<Scalar>& result) const noexcept {
    if (!knows_attitude_) {
      return Status::unbounded;
    }
    if (const Status status = validate(criterion); status != Status::ok) {
      return status;
    }
    Ellipsoid<Scalar, 3> best = projection<0, 3>(set_);
    // Whatever ends the search for a smaller one, what was found before it holds.
    const auto search = [&](const auto& asked) { return shrink(asked, criterion, best); };
    static_cast<void>(is_product_ ? answered<3>(search) : answered<6>(search));
    // About its own center, beside any vector.
    Ellipsoid<Scalar, 6> beside{Vector6<Scalar>::Zero(), Matrix6<Scalar>::Identity()};
    beside.center.template head<3>() = best.center;
    beside.shape.template topLeftCorner<3, 3>() = best.shape;
    Set placed;
    if (const Status status = recentred(origin_, beside, placed); status != Status::ok) {
      return status;
    }
    result = {placed.center.attitude, placed.shape.template topLeftCorner<3, 3>()};
    return Status::ok;
  }

  /// \name For the filter
  ///@{
  void forget() noexcept { knows_attitude_ = false; }

  /// \param fused the errors about `origin` that the filter found, and `placed` the same about its own center.
  void set_about(const State& origin, const Ellipsoid<Scalar, 6>& fused, const Set& placed, bool is_product) noexcept {
    knows_attitude_ = true;
    is_product_ = is_product;
    origin_ = origin;
    set_ = fused;
    largest_square_ = placed.shape.template topLeftCorner<3, 3>().trace();
    has_past_ = false;
    count_ = 0;
  }

  /// The prediction, about the same origin.
  void add_past(const Matrix6<Scalar>& shape) noexcept {
    past_ = shape;
    has_past_ = true;
  }

  /// One more, about the same origin. Any of them may be left out.
  void add(const HalfQuadric<Scalar>& quadric) noexcept {
    if (count_ < most_kept) {
      quadrics_[count_++] = quadric;
    }
  }
  ///@}

 private:
  static constexpr std::size_t slabs = 3;
  static constexpr std::size_t most_kept =
      most_questioned + slabs < most_quadrics ? most_questioned : most_quadrics - slabs;

  /// Constraints of the first N coordinates, for one question: a set, within which all others are seen.
  template <int N>
  struct Asked {
    Ellipsoid<Scalar, N> set;
    std::array<Quadric<Scalar, N>, most_kept + 1> quadrics;
    std::size_t count = 0;
  };

  [[nodiscard]] Status checked(const Vector3<Scalar>& direction) const noexcept {
    if (!scalar::all_finite(direction)) {
      return Status::not_finite;
    }
    if (!(direction.cwiseAbs().maxCoeff() > Scalar(0))) {
      return Status::zero_direction;
    }
    return knows_attitude_ ? Status::ok : Status::unbounded;
  }

  template <int N>
  [[nodiscard]] static Quadric<Scalar, N> of_first(const HalfQuadric<Scalar>& half) noexcept {
    if constexpr (N == 3) {
      return half.quadric;
    } else {
      return extended(half);
    }
  }

  /// \param answer of constraints; if they prove that nothing satisfies all, though fusion found no contradiction, of
  /// the set alone: no more than that is claimed then.
  template <int N, typename Answer>
  [[nodiscard]] Status answered(const Answer& answer) const noexcept {
    Asked<N> asked;
    asked.set = projection<0, N>(set_);
    if (has_past_) {
      const Ellipsoid<Scalar, N> past{Vector<Scalar, N>::Zero(), past_.template topLeftCorner<N, N>()};
      if (to_quadric(past, asked.quadrics[0]) == Status::ok) {
        asked.count = 1;
      }
    }
    for (std::size_t k = 0; k < count_; ++k) {
      if (N == 6 || quadrics_[k].half == Half::first) {
        asked.quadrics[asked.count++] = of_first<N>(quadrics_[k]);
      }
    }
    const Status status = answer(asked);
    if (status != Status::empty_intersection) {
      return status;
    }
    asked.count = 0;
    return answer(asked);
  }

  /// With ĝ the set's center as it is seen from the origin, (16.3) is n·g⁺ = v/w, v = n·(g − ĝ − ĝ×g) and w = 1 + ĝ·g:
  /// how large may wv/w² be? The center, the axis, and the entries of both forms are right to a few roundings of one,
  /// which are a turn of the center by 1 + ‖g⁺‖² as many at most.
  template <int N>
  [[nodiscard]] Status turn_of(const Asked<N>& asked, const Vector3<Scalar>& n,
                               Interval<Scalar>& angle) const noexcept {
    const Scalar half = scalar::constant<Scalar>(0.5L);
    const Vector3<Scalar> g = half * asked.set.center.template head<3>();
    Vector<Scalar, N + 1> w = Vector<Scalar, N + 1>::Zero();
    w(0) = Scalar(1);
    w.template segment<3>(1) = half * g;
    Vector<Scalar, N + 1> v = Vector<Scalar, N + 1>::Zero();
    v(0) = -n.dot(g);
    v.template segment<3>(1) = half * (n - n.cross(g));
    const Matrix<Scalar, N + 1> one = w.lazyProduct(w.transpose());
    const Matrix<Scalar, N + 1> product = w.lazyProduct(v.transpose());
    const Matrix<Scalar, N + 1> along = symmetrized(product);
    QuestionedSet<Scalar, N> questioned;
    if (const Status status = questioned.see(asked.set, asked.quadrics.data(), asked.count); status != Status::ok) {
      return status;
    }
    Scalar most;
    if (const Status status = questioned.largest_quotient(along, one, most); status != Status::ok) {
      return status;
    }
    Scalar least;
    if (const Status status = questioned.largest_quotient(Matrix<Scalar, N + 1>(-along), one, least);
        status != Status::ok) {
      return status;
    }
    if (!(most + least >= Scalar(0))) {
      return Status::empty_intersection;
    }
    const Scalar reach = Scalar(1) + scalar::constant<Scalar>(0.25L) * largest_square_;
    const Scalar slip = rounding::share<Scalar>(rounding::center + rounding::direction + rounding::turn_forms) * reach;
    angle = {-detail::turn_of_tangent(least, slip), detail::turn_of_tangent(most, slip)};
    return Status::ok;
  }

  /// Replaces the set by a smaller one, if there is one.
  template <int N>
  [[nodiscard]] Status shrink(const Asked<N>& asked, const SizeCriterion<Scalar, 3>& criterion,
                              Ellipsoid<Scalar, 3>& best) const noexcept {
    using Given = std::conditional_t<N == 3, Quadric<Scalar, 3>, HalfQuadric<Scalar>>;
    std::array<Given, most_kept + slabs> quadrics;
    std::size_t count = 0;
    for (std::size_t k = 0; asked.count > 0 && k < count_; ++k) {
      if constexpr (N == 3) {
        if (quadrics_[k].half == Half::first) {
          quadrics[count++] = quadrics_[k].quadric;
        }
      } else {
        quadrics[count++] = quadrics_[k];
      }
    }
    const Ellipsoid<Scalar, N> past =
        has_past_ && asked.count > 0
            ? Ellipsoid<Scalar, N>{Vector<Scalar, N>::Zero(), past_.template topLeftCorner<N, N>()}
            : asked.set;
    const auto take = [&](const Ellipsoid<Scalar, 3>& start) {
      Ellipsoid<Scalar, 3> found;
      const Status status = minimal_projection(&past, quadrics.data(), count, criterion, start.shape, found);
      if (status == Status::ok && detail::is_smaller_set(found, best, criterion)) {
        best = found;
      }
      return status;
    };
    if (const Status status = take(best); status == Status::empty_intersection) {
      return status;
    }
    PrincipalAxes<Scalar, 3> axes;
    if (principal_axes(best, axes) != Status::ok) {
      return Status::ok;
    }
    for (int i = 0; i < 3; ++i) {
      const Vector3<Scalar> axis = axes.directions.col(i);
      Vector<Scalar, N> whole = Vector<Scalar, N>::Zero();
      whole.template head<3>() = axis;
      Interval<Scalar> extent;
      const Status status = extent_along(asked.set, asked.quadrics.data(), asked.count, whole, extent);
      if (status == Status::empty_intersection) {
        return status;
      }
      Quadric<Scalar, 3> between;
      if (status == Status::ok && slab_of(axis, extent, between) == Status::ok) {
        if constexpr (N == 3) {
          quadrics[count++] = between;
        } else {
          quadrics[count++] = of_attitude(between);
        }
      }
    }
    return take(best);
  }

  /// The slab in which nᵀγ is in an interval, or a little wider.
  [[nodiscard]] static Status slab_of(const Vector3<Scalar>& n, const Interval<Scalar>& extent,
                                      Quadric<Scalar, 3>& quadric) noexcept {
    const Scalar middle = scalar::constant<Scalar>(0.5L) * (extent.least + extent.most);
    const Scalar below = middle - extent.least;
    const Scalar above = extent.most - middle;
    return slab(n, middle, rounding::enlarged(below > above ? below : above, rounding::slab), quadric);
  }

  bool knows_attitude_ = false;
  bool is_product_ = false;
  bool has_past_ = false;
  State origin_;              // of the coordinates [γ; δ] of all that follows
  Ellipsoid<Scalar, 6> set_;  // that the filter fused; of a product both blocks are sets of their own
  Scalar largest_square_;     // of ‖γ‖ about the center of the filter's set, at most
  Matrix6<Scalar> past_;      // shape of the prediction, about the origin
  std::array<HalfQuadric<Scalar>, most_kept> quadrics_;
  std::size_t count_ = 0;
};

}  // namespace elliptude
