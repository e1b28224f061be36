#pragma once

/// \file
/// Items of a call dealt out to threads, block by block.

#include <algorithm>
#include <atomic>
#include <elliptude/base/status.hpp>
#include <exception>
#include <limits>
#include <mutex>
#include <thread>
#include <vector>

#include "arrays.hpp"

namespace elliptude::python {

/// The first item that failed, whichever thread saw it.
class FirstFailure {
 public:
  void note(Index item, Status status) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (item < item_) {
      item_ = item;
      status_ = status;
    }
  }
  [[nodiscard]] Index item() const noexcept { return item_; }
  [[nodiscard]] Status status() const noexcept { return status_; }

 private:
  std::mutex mutex_;
  Index item_ = std::numeric_limits<Index>::max();
  Status status_ = Status::ok;
};

/// How many threads a call takes: those of its argument, or as many as there are processors and as the work is worth.
/// \param worth how many threads have enough to do to be worth their start.
/// \throws TypeError, ValueError unless the argument is None or an integer of at least 1.
[[nodiscard]] Index thread_count(const py::object& threads, double worth);

/// Calls `solve(first, size)` for all blocks of at most `block` of the items, on threads that take one block after another, until one
/// returns false; every block before that one is then done, too.
template <typename Solve>
void in_blocks(Index count, Index block, Index threads, const Solve& solve) {
  std::atomic<Index> next{0};
  std::atomic<bool> stopped{false};
  const auto work = [&]() noexcept {
    for (Index first = block * next++; first < count && !stopped; first = block * next++) {
      if (!solve(first, std::min(block, count - first))) {
        stopped = true;
      }
    }
  };
  std::vector<std::thread> others;
  for (Index i = 1; i < std::min(threads, (count + block - 1) / block); ++i) {
    try {
      others.emplace_back(work);
    } catch (const std::exception&) {  // no more threads, or no memory for them: those that there are do the work
      break;
    }
  }
  work();
  for (std::thread& other : others) {
    other.join();
  }
}

}  // namespace elliptude::python
