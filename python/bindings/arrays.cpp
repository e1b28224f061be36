#include "arrays.hpp"

#include <algorithm>
#include <elliptude/base/so3.hpp>
#include <limits>
#include <utility>

namespace elliptude::python {

namespace {

/// Whether a value is one of NumPy's masked arrays, or a list that holds one.
[[nodiscard]] bool is_masked(const py::handle& value) {
  PyObject* const object = value.ptr();
  if (PyFloat_CheckExact(object) != 0 || PyLong_CheckExact(object) != 0 ||
      Py_TYPE(object) == py::detail::npy_api::get().PyArray_Type_) {
    return false;
  }
  if (PyList_CheckExact(object) != 0 || PyTuple_CheckExact(object) != 0) {
    const auto sequence = py::reinterpret_borrow<py::sequence>(value);
    return std::any_of(sequence.begin(), sequence.end(), [](const py::handle& one) { return is_masked(one); });
  }
  return py::isinstance<py::array>(value) && py::hasattr(value, "mask");
}

/// A value without masks. NumPy's own conversion drops a mask and keeps the numbers below it: what is masked is NaN here,
/// which is what was not measured where a function says so, and is refused elsewhere.
[[nodiscard]] py::object unmasked(const py::handle& value) {
  if (!is_masked(value)) {
    return py::reinterpret_borrow<py::object>(value);
  }
  if (!py::isinstance<py::array>(value)) {
    py::list items;
    for (const py::handle& one : value) {
      items.append(unmasked(one));
    }
    return std::move(items);
  }
  const char kind = py::reinterpret_borrow<py::array>(value).dtype().kind();
  if (kind != 'f' && kind != 'i' && kind != 'u') {
    return value.attr("data");
  }
  return value.attr("astype")("float64").attr("filled")(std::numeric_limits<double>::quiet_NaN());
}

}  // namespace

Array real_array(const py::handle& value, const std::string& name) {
  py::object any;
  try {
    any = py::module_::import("numpy").attr("asarray")(unmasked(value));
  } catch (py::error_already_set& error) {
    if (!error.matches(PyExc_ValueError)) {
      throw;
    }
    value_error(name + " is not an array: " + py::str(error.value()).cast<std::string>());
  }
  const auto array = py::reinterpret_borrow<py::array>(any);
  const char kind = array.dtype().kind();
  if (kind != 'f' && kind != 'i' && kind != 'u') {
    throw py::type_error(name + " must hold real numbers, not " + py::str(array.dtype()).cast<std::string>() +
                         " (from " + Py_TYPE(value.ptr())->tp_name + ")");
  }
  auto converted = Array::ensure(array);
  if (!converted) {
    throw py::error_already_set();
  }
  return converted;
}

namespace {

[[nodiscard]] std::string length_text(Index length) { return length == any_length ? "n" : std::to_string(length); }

}  // namespace

std::string text(const Shape& shape) {
  std::string result = "(";
  for (std::size_t i = 0; i < shape.size(); ++i) {
    result += (i > 0 ? ", " : "") + length_text(shape[i]);
  }
  return result + (shape.size() == 1 ? ",)" : ")");
}

Index count_of(const Shape& leading) {
  Index count = 1;
  for (const Index length : leading) {
    count *= length;
  }
  return count;
}

std::string place(const Shape& leading, Index index) {
  if (leading.empty()) {
    return {};
  }
  std::string result;
  for (std::size_t i = leading.size(); i-- > 0;) {
    result = (i > 0 ? ", " : "") + std::to_string(index % leading[i]) + result;
    index /= leading[i];
  }
  return "[" + result + "]";
}

Items::Items(const py::handle& value, std::string name, Shape item, Require require, Batch batch)
    : name_(std::move(name)), array_(real_array(value, name_)), item_(std::move(item)) {
  const Shape shape(array_.shape(), array_.shape() + array_.ndim());
  const std::size_t rank = item_.size();
  bool fits = batch == Batch::allowed ? shape.size() >= rank : shape.size() == rank;
  for (std::size_t i = 0; fits && i < rank; ++i) {
    const Index length = shape[shape.size() - rank + i];
    fits = item_[i] == any_length ? length > 0 : length == item_[i];
  }
  if (!fits) {
    std::string wanted = text(item_);
    if (batch == Batch::allowed) {
      wanted = rank > 1 ? "(..., " + wanted.substr(1) : (rank == 1 ? "(..., " + length_text(item_[0]) + ")" : "(...)");
    } else if (rank == 0) {
      wanted = "() of a number";
    }
    value_error(name_ + " must have the shape " + wanted + ", not " + text(shape));
  }
  leading_.assign(shape.begin(), shape.end() - static_cast<Index>(rank));
  item_.assign(shape.end() - static_cast<Index>(rank), shape.end());
  data_ = array_.data();
  stride_ = count_of(item_);
  if (require == Require::finite) {
    const py::gil_scoped_release release;
    require_finite();
  }
}

void Items::require_finite() const {
  const Index size = count() * stride_;
  for (Index i = 0; i < size; ++i) {
    if (!scalar::isfinite(data_[i])) {
      Shape shape = leading_;
      shape.insert(shape.end(), item_.begin(), item_.end());
      value_error(name_ + " must be finite, but " + name_ + place(shape, i) + " is " + text(data_[i]));
    }
  }
}

Shape broadcast(std::initializer_list<Items*> arguments) {
  std::size_t rank = 0;
  for (const Items* argument : arguments) {
    rank = std::max(rank, argument->leading_.size());
  }
  Shape common(rank, 1);
  const Items* shaper = nullptr;  // the last argument that gave the common shape a length, for the message
  for (const Items* argument : arguments) {
    const std::size_t offset = rank - argument->leading_.size();
    for (std::size_t i = 0; i < argument->leading_.size(); ++i) {
      const Index length = argument->leading_[i];
      if (length == 1 || length == common[offset + i]) {
        continue;
      }
      if (common[offset + i] != 1) {
        value_error(argument->name_ + " has the batch shape " + text(argument->leading_) +
                    ", which does not fit that of " + shaper->name_ + ", " + text(shaper->leading_));
      }
      common[offset + i] = length;
      shaper = argument;
    }
  }
  for (Items* argument : arguments) {
    if (argument->leading_ == common) {
      continue;
    }
    if (argument->count() == 1) {
      argument->stride_ = 0;
    } else {
      py::list shape;
      for (const Shape* part : {&common, &argument->item_}) {
        for (const Index length : *part) {
          shape.append(length);
        }
      }
      const py::object view = py::module_::import("numpy").attr("broadcast_to")(argument->array_, py::tuple(shape));
      argument->array_ = Array::ensure(view);
      argument->data_ = argument->array_.data();
    }
    argument->leading_ = common;
  }
  return common;
}

Items single(const py::handle& value, const std::string& name, Shape item) {
  return {value, name, std::move(item), Items::Require::finite, Items::Batch::none};
}

void require_rotation(const Matrix3<double>& matrix, const std::string& label) {
  const double limit = rotation_tolerance<double>();
  if (is_rotation(matrix, limit)) {
    return;
  }
  const double defect = (matrix.transpose() * matrix - Matrix3<double>::Identity()).cwiseAbs().maxCoeff();
  if (!(defect <= limit)) {
    value_error(label + " must be a rotation, but an entry of CᵀC − I is " + text(defect) + " in size (limit " +
                text(limit) + ")");
  }
  value_error(label + " must be a rotation, but its determinant is " + text(matrix.determinant()) + ", not 1");
}

Items attitudes(const py::handle& value, const std::string& name, Items::Batch batch) {
  const bool has_matrix = py::hasattr(value, "as_matrix");
  const py::object matrices =
      has_matrix ? py::object(value.attr("as_matrix")()) : py::reinterpret_borrow<py::object>(value);
  Items result(matrices, name, {3, 3}, Items::Require::finite, batch);
  const py::gil_scoped_release release;
  const Index count = result.count();
  for (Index i = 0; i < count; ++i) {
    const Matrix3<double> attitude = result.matrix3(i);
    if (!is_rotation(attitude, rotation_tolerance<double>())) {
      require_rotation(attitude, result.label(i));
    }
  }
  return result;
}

Matrix3<double> single_attitude(const py::handle& value, const std::string& name) {
  return attitudes(value, name, Items::Batch::none).matrix3(0);
}

Results::Results(const Shape& leading, const Shape& item) : stride_(count_of(item)) {
  Shape shape = leading;
  shape.insert(shape.end(), item.begin(), item.end());
  array_ = py::array_t<double>(shape);
  data_ = array_.mutable_data();
}

py::object Results::object() const { return array_.ndim() > 0 ? py::object(array_) : py::object(array_[py::tuple()]); }

}  // namespace elliptude::python
