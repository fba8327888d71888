#pragma once
#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace overfly::tradeoff {

// Repeated measurements of one duration, milliseconds.
struct Timing {
  double median_ms = 0, least_ms = 0, most_ms = 0;
  int repeats = 0;

  // (most - least) / median: above kNoisy the machine was busy with something else, and the report says so.
  [[nodiscard]] double spread() const { return median_ms > 0 ? (most_ms - least_ms) / median_ms : 0; }
  [[nodiscard]] bool noisy() const { return spread() > kNoisy; }
  static constexpr double kNoisy = 0.15;
};
[[nodiscard]] Timing timingOf(std::vector<double> milliseconds);

// One setting that was tried: what it cost and what it gave.
struct Trial {
  std::string part{};     // "sweep", "adjustment", "colour", "heights", "preview", "precision"
  std::string axis{};     // the one setting that differs from the default; "combined" where several do
  std::string setting{};  // "images 6"
  bool is_default = false;
  Timing processor{};  // processor time of all threads: what a busy machine does not change much
  Timing wall{};
  std::string error_name{};                               // what `error` is and its unit
  double error = 0;                                       // less is better
  std::vector<std::pair<std::string, double>> figures{};  // everything else, name with unit first
  bool on_front = false;
};

// Processor time of this process (all threads) and wall time of a call, in milliseconds.
struct Elapsed {
  double processor_ms = 0, wall_ms = 0;
};
[[nodiscard]] Elapsed elapsedOf(const std::function<void()>& work);

// Marks the trials of one part that no other beats in both time (processor) and error. Equal ones: the first.
void markFront(std::vector<Trial>& trials);

}  // namespace overfly::tradeoff
