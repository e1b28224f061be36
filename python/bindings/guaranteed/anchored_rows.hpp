#pragma once

/// \file
/// Rows of a log that are each predicted from an anchor, on several threads: rows between two anchors know nothing of each other.

#include <algorithm>
#include <exception>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "guaranteed/rows.hpp"
#include "threads.hpp"

namespace elliptude::python {

/// Goes through rows in groups that have one anchor: the last row of a group is the anchor of the next. The last rows are run one after
/// the other, some hundred at a time, and then all rows between them in any order. What comes of a row depends on neither.
template <typename Filter, typename Row>
class AnchoredRows {
 public:
  /// \param run takes a copy of the anchor's filter to a row, given by its number and whether it is the first of its group.
  AnchoredRows(const Anchors& from, Index rows, Index threads, const Row& run)
      : from_(from), rows_(rows), threads_(threads), run_(run), caller_(std::this_thread::get_id()) {}

  /// Without the interpreter's lock. After an exception `filter` is what it was at the first row that failed, and `row` is that row.
  void run(Filter& filter, Index& row) {
    for (Index first = 0; first < rows_; first = end_) {
      run_ends(first, filter);
      run_between(first);
      if (interrupted_) {
        const py::gil_scoped_acquire acquire;
        throw py::error_already_set();
      }
      if (failure_) {
        filter = failure_->filter;
        row = failure_->row;
        std::rethrow_exception(failure_->error);
      }
    }
  }

 private:
  struct Failure {
    Index row;
    Filter filter;
    std::exception_ptr error;
  };
  struct Group {
    Index first;
    Filter anchor;
  };
  static constexpr std::size_t most_groups = 256;
  static constexpr Index block = 64;

  /// The last rows of the next groups, in their order.
  void run_ends(Index first, Filter& filter) {
    groups_.clear();
    end_ = first;
    while (end_ < rows_ && groups_.size() < most_groups && !failure_) {
      groups_.push_back({end_, filter});
      end_ = from_.end_of_group(end_);
      try_row(end_ - 1, groups_.back(), filter);
    }
  }

  /// The other rows of these groups. One that failed at its last row has them, too: an earlier row may have failed.
  void run_between(Index first) {
    const Index rows = end_ - first;
    if (rows == static_cast<Index>(groups_.size())) {
      return;
    }
    in_blocks(rows, block, threads_, [&](Index begin, Index size) {
      if (std::this_thread::get_id() == caller_ && is_interrupted()) {
        return false;
      }
      bool succeeds = true;
      for (Index i = first + begin; i < first + begin + size && succeeds; ++i) {
        const auto after = std::upper_bound(groups_.begin(), groups_.end(), i,
                                            [](Index row, const Group& group) { return row < group.first; });
        const bool is_last = i + 1 == (after == groups_.end() ? end_ : after->first);
        Filter filter = std::prev(after)->anchor;
        succeeds = is_last || try_row(i, *std::prev(after), filter);
      }
      return succeeds;
    });
  }

  /// \return false if it failed, which is noted if no earlier row has.
  bool try_row(Index row, const Group& group, Filter& filter) {
    filter = group.anchor;
    try {
      run_(filter, row, row == group.first);
    } catch (...) {
      const std::lock_guard<std::mutex> lock(mutex_);
      if (!failure_ || row < failure_->row) {
        failure_ = Failure{row, filter, std::current_exception()};
      }
      return false;
    }
    return true;
  }

  /// Whether the user has stopped the call: only the thread that made it may ask.
  bool is_interrupted() {
    const py::gil_scoped_acquire acquire;
    interrupted_ = interrupted_ || PyErr_CheckSignals() != 0;
    return interrupted_;
  }

  const Anchors& from_;
  Index rows_;
  Index threads_;
  const Row& run_;
  std::thread::id caller_;
  std::vector<Group> groups_;  ///< those that are being run
  Index end_ = 0;              ///< one beyond their last row
  bool interrupted_ = false;   ///< by the caller
  std::mutex mutex_;
  std::optional<Failure> failure_;  ///< of the first row that failed
};

}  // namespace elliptude::python
