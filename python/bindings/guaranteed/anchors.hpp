#pragma once

/// \file
/// From which rows of a log others are predicted.

#include "arrays.hpp"
#include "errors.hpp"

namespace elliptude::python {

/// From which row on each is predicted, (n,) integers.
class Anchors {
 public:
  Anchors(const py::object& value, Index rows) : rows_(single(value, "anchors", {rows})) {
    for (Index i = 0; i < rows; ++i) {
      const double anchor = rows_[0][i];
      if (anchor != static_cast<double>(i - 1) && (i == 0 || anchor != rows_[0][i - 1])) {
        value_error("anchors[" + std::to_string(i) + "] must be " + std::to_string(i - 1) +
                    ", the row before (-1: the filter as it is)" +
                    (i == 0 ? "" : ", or " + text(rows_[0][i - 1]) + " as for that row") + ", but is " + text(anchor));
      }
    }
  }

  [[nodiscard]] bool begins_at_row_before(Index row) const noexcept {
    return rows_[0][row] == static_cast<double>(row - 1);
  }

 private:
  Items rows_;
};

}  // namespace elliptude::python
