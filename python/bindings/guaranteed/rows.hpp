#pragma once

/// \file
/// What both filters need to run over the rows of a log: from which rows others are predicted, and a copy to work with.

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

  /// One beyond the last row that has the same anchor as a row, which is the first of these.
  [[nodiscard]] Index end_of_group(Index row) const noexcept {
    do {
      ++row;
    } while (row < rows_.item()[0] && !begins_at_row_before(row));
    return row;
  }

 private:
  Items rows_;
};

/// Runs `loop` with a copy of a filter and the index of its row, and takes the copy up at the end. After a contradiction the filter is
/// as it was predicted to the row, so that the user may go on from there; after any other error as before.
/// \throws RowFault for a ValueError of a row.
template <typename Filter, typename Loop>
void run_on_copy(Filter& filter, const Loop& loop) {
  Filter working = filter;
  Index row = 0;
  try {
    loop(working, row);
  } catch (InconsistentSets& error) {
    filter = working;
    error.set_row(row);
    throw;
  } catch (const py::value_error& error) {
    throw RowFault(error.what(), row);
  }
  filter = working;
}

}  // namespace elliptude::python
