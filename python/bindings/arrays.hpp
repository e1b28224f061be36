#pragma once

/// \file
/// Arrays in and out. An argument has the shape (..., trailing): any number of leading dimensions, which are a batch and
/// broadcast against those of the other arguments, and trailing ones, which are the shape of one item.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <cstdint>
#include <elliptude/base/scalar.hpp>
#include <initializer_list>
#include <string>
#include <vector>

#include "errors.hpp"

namespace elliptude::python {

namespace py = pybind11;

using Index = py::ssize_t;
using Shape = std::vector<Index>;
using Array = py::array_t<double, py::array::c_style | py::array::forcecast>;

/// NumPy's order of the entries of a 3x3 matrix; Eigen's own is the other one.
using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Any length, in an item's shape.
inline constexpr Index any_length = -1;

/// A float64 array of an argument, which must hold real numbers (of any kind that NumPy casts to float64 safely).
/// \throws TypeError, ValueError.
[[nodiscard]] Array real_array(const py::handle& value, const std::string& name);

/// "(3, 3)".
[[nodiscard]] std::string text(const Shape& shape);

/// The number of items of a batch.
[[nodiscard]] Index count_of(const Shape& leading);

/// "[2, 1]", the place of item `index` in a batch; nothing for a single item.
[[nodiscard]] std::string place(const Shape& leading, Index index);

/// An argument of the shape (..., item) that holds finite numbers.
class Items {
 public:
  enum class Require : std::uint8_t { finite, anything };
  enum class Batch : std::uint8_t { allowed, none };

  /// \throws TypeError, ValueError with the argument's name.
  Items(const py::handle& value, std::string name, Shape item, Require require = Require::finite,
        Batch batch = Batch::allowed);

  [[nodiscard]] const std::string& name() const noexcept { return name_; }
  [[nodiscard]] const Shape& leading() const noexcept { return leading_; }
  /// The shape of one item, with the lengths that it has.
  [[nodiscard]] const Shape& item() const noexcept { return item_; }
  [[nodiscard]] Index count() const noexcept { return count_of(leading_); }

  [[nodiscard]] const double* operator[](Index i) const noexcept { return data_ + i * stride_; }
  /// Numbers from one item to the next; none where all items of a batch are the same.
  [[nodiscard]] Index stride() const noexcept { return stride_; }
  [[nodiscard]] double number(Index i) const noexcept { return *(*this)[i]; }
  template <int Size>
  [[nodiscard]] Vector<double, Size> vector(Index i) const noexcept {
    return Eigen::Map<const Vector<double, Size>>((*this)[i]);
  }
  [[nodiscard]] Matrix3<double> matrix3(Index i) const noexcept { return Eigen::Map<const RowMajor3>((*this)[i]); }
  [[nodiscard]] Eigen::VectorXd dynamic_vector(Index i = 0) const {
    return Eigen::Map<const Eigen::VectorXd>((*this)[i], item_[0]);
  }
  [[nodiscard]] Eigen::MatrixXd dynamic_matrix(Index i = 0) const {
    return Eigen::Map<const RowMajor>((*this)[i], item_[0], item_[1]);
  }

  /// "attitude[2]", how a message calls an item.
  [[nodiscard]] std::string label(Index i) const { return name_ + place(leading_, i); }

  /// Gives every argument the same leading shape, by NumPy's rules of broadcasting, and returns it.
  friend Shape broadcast(std::initializer_list<Items*> arguments);

 private:
  void require_finite() const;

  std::string name_;
  Array array_;
  Shape leading_;
  Shape item_;
  const double* data_;
  Index stride_;  // numbers from one item to the next
};

Shape broadcast(std::initializer_list<Items*> arguments);

/// An argument that is one item.
[[nodiscard]] Items single(const py::handle& value, const std::string& name, Shape item);

/// Attitudes (..., 3, 3): an array, or what has `as_matrix()`, as SciPy's Rotation.
/// \throws ValueError unless each is a rotation.
[[nodiscard]] Items attitudes(const py::handle& value, const std::string& name,
                              Items::Batch batch = Items::Batch::allowed);
[[nodiscard]] Matrix3<double> single_attitude(const py::handle& value, const std::string& name);

/// \throws ValueError, naming what is wrong with the matrix, unless it is a rotation.
void require_rotation(const Matrix3<double>& matrix, const std::string& label);

/// A new array of the shape (..., item), to be filled.
class Results {
 public:
  Results(const Shape& leading, const Shape& item);

  [[nodiscard]] double* operator[](Index i) noexcept { return data_ + i * stride_; }
  template <typename Derived>
  void set(Index i, const Eigen::MatrixBase<Derived>& value) noexcept {
    using RowMajorValue = Eigen::Matrix<double, Derived::RowsAtCompileTime, Derived::ColsAtCompileTime,
                                        Derived::ColsAtCompileTime == 1 ? Eigen::ColMajor : Eigen::RowMajor>;
    Eigen::Map<RowMajorValue>((*this)[i], value.rows(), value.cols()) = value;
  }
  void set(Index i, double value) noexcept { *(*this)[i] = value; }

  [[nodiscard]] py::array array() const { return array_; }
  /// As `array`, but a number instead of an array without dimensions.
  [[nodiscard]] py::object object() const;

 private:
  py::array_t<double> array_;
  double* data_;
  Index stride_;
};

/// f(item index) into a new array, without the interpreter's lock.
template <typename Function>
[[nodiscard]] py::object map_items(const Shape& leading, const Shape& item, const Function& f) {
  Results results(leading, item);
  {
    const py::gil_scoped_release release;
    const Index count = count_of(leading);
    for (Index i = 0; i < count; ++i) {
      results.set(i, f(i));
    }
  }
  return results.object();
}

/// As `map_items`, for answers of yes and no.
template <typename Function>
[[nodiscard]] py::object map_questions(const Shape& leading, const Function& f) {
  py::array_t<bool> answers(leading);
  bool* data = answers.mutable_data();
  {
    const py::gil_scoped_release release;
    const Index count = count_of(leading);
    for (Index i = 0; i < count; ++i) {
      data[i] = f(i);
    }
  }
  return answers.ndim() > 0 ? py::object(answers) : py::object(answers[py::tuple()]);
}

/// Array of a vector or a matrix.
template <typename Derived>
[[nodiscard]] py::array to_array(const Eigen::MatrixBase<Derived>& value) {
  Results results({}, Derived::ColsAtCompileTime == 1 ? Shape{value.rows()} : Shape{value.rows(), value.cols()});
  results.set(0, value);
  return results.array();
}

/// As `to_array`, not writeable: what a property of an immutable object returns.
template <typename Derived>
[[nodiscard]] py::array to_constant_array(const Eigen::MatrixBase<Derived>& value) {
  py::array array = to_array(value);
  array.attr("flags").attr("writeable") = false;
  return array;
}

}  // namespace elliptude::python
