#pragma once
#include <cstddef>
#include <mutex>
#include <utility>
#include <vector>

namespace overfly::tiling {

// Memory of values that are no longer needed, for the next ones of their kind: large blocks that come and go
// with every tile would leave holes in the heap, which then grows with the map. Thread-safe.
template <typename Value>
class Spare {
 public:
  // At most that many are kept.
  explicit Spare(std::size_t most) : most_(most) {}

  // The value last given, as it was; a new one when there is none.
  [[nodiscard]] Value take() {
    const std::scoped_lock lock(mutex_);
    if (values_.empty()) return {};
    Value value = std::move(values_.back());
    values_.pop_back();
    return value;
  }
  void give(Value&& value) {
    const std::scoped_lock lock(mutex_);
    if (values_.size() < most_) values_.push_back(std::move(value));
  }

 private:
  const std::size_t most_;
  std::mutex mutex_;
  std::vector<Value> values_;
};

}  // namespace overfly::tiling
