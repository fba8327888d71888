#pragma once
#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <unordered_map>
#include <utility>

namespace overfly::tiling {

// Which values stay within a budget of bytes: the least recently used go first, those that somebody still
// holds (a shared_ptr outside) never. When all are held the budget is overrun rather than a caller refused.
// Pure logic, knows no GPU. Not thread-safe.
template <typename Value>
class PinnedLru {
 public:
  using Ptr = std::shared_ptr<const Value>;

  explicit PinnedLru(std::size_t budget_bytes) : budget_(budget_bytes) {}

  // Null when absent; else it is now the most recently used.
  [[nodiscard]] Ptr find(std::uint64_t key) {
    const auto at = index_.find(key);
    if (at == index_.end()) return nullptr;
    entries_.splice(entries_.begin(), entries_, at->second);
    return at->second->value;
  }

  // Replaces an earlier value of the key, then evicts down to the budget.
  void insert(std::uint64_t key, Ptr value, std::size_t bytes) {
    erase(key);
    entries_.push_front({key, std::move(value), bytes});
    index_[key] = entries_.begin();
    bytes_ += bytes;
    // The newest is what the caller asked for.
    for (auto at = entries_.end(); bytes_ > budget_ && at != std::next(entries_.begin());) {
      --at;
      if (at->value.use_count() > 1) continue;
      const auto gone = at++;
      remove(gone);
      ++evictions_;
    }
  }

  void erase(std::uint64_t key) {
    const auto at = index_.find(key);
    if (at != index_.end()) remove(at->second);
  }
  void clear() {
    entries_.clear();
    index_.clear();
    bytes_ = 0;
  }

  [[nodiscard]] std::size_t bytes() const { return bytes_; }
  [[nodiscard]] std::size_t budget() const { return budget_; }
  [[nodiscard]] std::size_t size() const { return entries_.size(); }
  [[nodiscard]] std::uint64_t evictions() const { return evictions_; }

 private:
  struct Entry {
    std::uint64_t key;
    Ptr value;
    std::size_t bytes;
  };
  using Entries = std::list<Entry>;  // most recently used first

  void remove(typename Entries::iterator at) {
    bytes_ -= at->bytes;
    index_.erase(at->key);
    entries_.erase(at);
  }

  std::size_t budget_;
  std::size_t bytes_ = 0;
  std::uint64_t evictions_ = 0;
  Entries entries_;
  std::unordered_map<std::uint64_t, typename Entries::iterator> index_;
};

}  // namespace overfly::tiling
