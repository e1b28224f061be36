#pragma once

/// \file
/// Many first-order filters that are alike, as Python has them.

#include <elliptude/first_order/filter.hpp>
#include <vector>

#include "first_order/filter_kernel.hpp"
#include "first_order/flow.hpp"
#include "measurement/arguments.hpp"
#include "threads.hpp"

namespace elliptude::python {

/// Filters with the same flow, mode, criterion and time. The docstrings in first_order/filters.cpp describe the functions.
class PythonFilters {
 public:
  PythonFilters(py::object flow, const py::object& attitude, const py::object& vector, const py::object& shape,
                const py::object& time, std::string mode, std::string criterion, const py::object& weight);

  [[nodiscard]] const py::object& flow() const noexcept { return flow_; }
  [[nodiscard]] const std::string& mode() const noexcept { return mode_; }
  [[nodiscard]] const std::string& criterion() const noexcept { return criterion_; }
  [[nodiscard]] py::object weight() const;
  [[nodiscard]] double time() const noexcept { return time_; }
  [[nodiscard]] Index count() const noexcept { return count_; }

  /// A matrix of each filter, which begins at a number of `FilterMemory`.
  template <int Rows, int Columns>
  [[nodiscard]] py::array matrices(std::size_t number) const {
    Results results({count_}, Columns == 1 ? Shape{Rows} : Shape{Rows, Columns});
    for (Index i = 0; i < count_; ++i) {
      results.set(i, matrix<Rows, Columns>(number, i));
    }
    return results.array();
  }

  void resume(const py::object& transition, const py::object& prior_shape);

  void predict(const py::object& time, const py::object& control_torque, const py::object& gyro,
               const py::object& threads);

  [[nodiscard]] py::object update(const py::object& directions, const py::object& reference, const py::object& bounds,
                                  const py::object& weights, const py::object& angular_velocity,
                                  const py::object& rate_bound, const std::string& on_inconsistent,
                                  const py::object& threads);

  [[nodiscard]] int traverse(visitproc visit, void* arg) const noexcept {
    Py_VISIT(flow_.ptr());
    return 0;
  }

 private:
  /// Filters of a thread's turn.
  static constexpr Index block = 64;

  template <int Rows, int Columns>
  [[nodiscard]] Matrix<double, Rows, Columns> matrix(std::size_t number, Index i) const noexcept {
    Matrix<double, Rows, Columns> result;
    for (int k = 0; k < Rows * Columns; ++k) {
      result.data()[k] = numbers_[(number + static_cast<std::size_t>(k)) * stride_ + static_cast<std::size_t>(i)];
    }
    return result;
  }
  /// Puts it also beyond the last filter, if it is that.
  template <typename Derived>
  void set(std::vector<double>& numbers, std::size_t number, Index i, const Eigen::MatrixBase<Derived>& value) const {
    const std::size_t end = i + 1 == count_ ? stride_ : static_cast<std::size_t>(i) + 1;
    for (Index k = 0; k < value.size(); ++k) {
      double* row = numbers.data() + (number + static_cast<std::size_t>(k)) * stride_;
      std::fill(row + i, row + end, value(k % value.rows(), k / value.rows()));
    }
  }

  void set_flow();
  [[nodiscard]] elliptude_kernels::FilterBlock in_memory(std::vector<double>& numbers, Index first,
                                                         Index size) const noexcept;
  void predict_alone(double time, const LogInput* input, std::vector<double>& numbers, std::vector<int>& statuses);
  void raise_unless_predicted(double time, const std::vector<int>& statuses) const;

  py::object flow_;
  std::string mode_;
  std::string criterion_;
  elliptude_kernels::FilterSettings settings_{};
  bool has_kernel_ = false;  ///< for predictions: those of a potential that no kernel has go one after the other
  Index count_ = 0;
  std::size_t stride_ = 0;
  std::vector<double> numbers_;
  double time_ = 0;
  std::unique_ptr<std::mutex> mutex_ = std::make_unique<std::mutex>();
};

}  // namespace elliptude::python
