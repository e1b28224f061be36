#pragma once

/// \file
/// A guaranteed filter's update by a linear measurement of the error about its center. (theory, section 16.2)

#include "elliptude/guaranteed/detail/filter_update.hpp"

namespace elliptude::detail {

/// An update of what a filter knows by one linear measurement.
template <typename Flow>
class FilterLinearUpdate {
 public:
  using Memory = FilterMemory<Flow>;
  using State = typename Memory::State;
  using Scalar = typename Memory::Scalar;
  using Set = typename Memory::Set;

  explicit FilterLinearUpdate(Memory& filter) noexcept : filter_(filter) {}

  /// `GuaranteedFilter::update`.
  template <int Rows>
  [[nodiscard]] Status run(const LinearMeasurement<Scalar, Rows>& measurement,
                           GuaranteedUpdate<Scalar>& update) noexcept {
    update = GuaranteedUpdate<Scalar>{};
    update.claim = filter_.claim;
    if (!filter_.known.has_attitude) {
      return Status::unbounded;
    }
    LinearMeasurement<Scalar, Rows> seen = measurement;
    if (filter_.leaves_vector()) {
      if (const Status status = without_vector(seen); status != Status::ok) {
        return status;
      }
    }
    Quadric<Scalar, 6> quadric;
    if (const Status status = to_quadric(seen, filter_.known.set, quadric); status != Status::ok) {
      return status;
    }
    QuadricFusion<Scalar, 6> fusion;
    Status status = Status::ok;
    if (!filter_.leaves_vector()) {
      const Ellipsoid<Scalar, 6> predicted = filter_.known.set.in_coordinates();
      status = minimal_intersection(&predicted, &quadric, 1, filter_.settings.criterion, fusion);
    } else {
      QuadricFusion<Scalar, 3> found;
      found.margin = Scalar(1);
      found.contradiction = QuadricFusion<Scalar, 3>::none;
      const Ellipsoid<Scalar, 3> predicted = attitude_of(filter_.known.set);
      const Quadric<Scalar, 3> of_attitude{quadric.a.template topLeftCorner<3, 3>(), quadric.g.template head<3>(),
                                           quadric.c};
      status =
          minimal_intersection(&predicted, &of_attitude, 1, filter_.settings.criterion.template of_first<3>(), found);
      put_search(found, fusion);
      if (status == Status::ok) {
        put_product(found, Ellipsoid<Scalar, 3>{Vector3<Scalar>::Zero(), filter_.known.vector_bound.shape}, fusion);
      }
    }
    GuaranteedUpdate<Scalar> result;
    if (status == Status::ok || status == Status::empty_intersection) {
      result.margin = fusion.margin;
      count_fusion(fusion, result);
    }
    if (status != Status::ok) {
      if (status == Status::empty_intersection) {
        report_contradiction(result, update);
      }
      return status;
    }
    if (!fusion.prediction_alone) {
      Set next;
      if (const Status placed = filter_.place(filter_.known.set.center, fusion.set, next); placed != Status::ok) {
        return placed;
      }
      filter_.known.set = next;
      filter_.constraints.count = 0;
    }
    result.claim = filter_.claim;
    result.prediction_used = true;
    update = result;
    return Status::ok;
  }

 private:
  /// y = H [ζ; δ] + v with δ in its bound: H_δ δ is one more error.
  template <int Rows>
  [[nodiscard]] Status without_vector(LinearMeasurement<Scalar, Rows>& measurement) const noexcept {
    if (!scalar::all_finite(measurement.h) || !scalar::all_finite(measurement.bound)) {
      return Status::not_finite;
    }
    const Matrix<Scalar, Rows, 3> h = measurement.h.template rightCols<3>();
    const Matrix<Scalar, Rows> added = covered_image(h, filter_.known.vector_bound.shape);
    if (added.trace() > Scalar(0)) {
      const Matrix<Scalar, Rows> sum = sum_of_shapes(measurement.bound, added);
      // A share of the diagonal, for a share of the whole does not cover a sum that is thin.
      measurement.bound = symmetrized(sum);
      measurement.bound.diagonal() *= Scalar(1) + rounding::share<Scalar>(rounding::sum);
      measurement.h.template rightCols<3>().setZero();
    }
    return Status::ok;
  }

  Memory& filter_;
};

}  // namespace elliptude::detail
