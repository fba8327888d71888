#pragma once
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>
#include <utility>

namespace overfly::cli {

// Tells on stderr how far a long command is: one bar that is redrawn on a terminal, otherwise a plain line at
// every tenth of the way. Says nothing at all when the work ends before it was due to be drawn first.
// Single thread.
class Progress {
 public:
  // `label` is what is being done ("importing frames"); total 0: the end is not known, and only the count is
  // shown.
  Progress(std::string label, std::uint64_t total);
  // As above with the stream and kind of output given instead of found out.
  Progress(std::string label, std::uint64_t total, std::FILE* out, bool terminal);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  // `done` of the total is done; `note` (a file name, say) stands behind the figures. Cheap: draws at most
  // ten times a second.
  void update(std::uint64_t done, const std::string& note = {});
  // Draws the last state and ends the line. The destructor does the same when the caller has not.
  void finish();

 private:
  void draw(const std::string& note);

  using Clock = std::chrono::steady_clock;
  std::string label_;
  std::uint64_t total_;
  std::uint64_t done_ = 0;
  std::FILE* out_;
  bool terminal_;
  bool drawn_ = false;
  bool finished_ = false;
  std::uint64_t next_line_ =
      1;  // tenth of the way (or decade of the count) that the next plain line is due at
  Clock::time_point started_ = Clock::now();
  Clock::time_point last_draw_ = started_;
};

// Progress of work that goes through several stages, one Progress each: a callback for those that tell the
// stage's name. Single thread.
class StageProgress {
 public:
  // `prefix` stands before the stages' names.
  explicit StageProgress(std::string prefix) : prefix_(std::move(prefix)) {}
  void operator()(const std::string& stage, std::uint64_t done, std::uint64_t total) {
    if (!progress_ || stage != stage_) progress_.emplace(prefix_ + stage, total);
    stage_ = stage;
    progress_->update(done);
  }
  void finish() { progress_.reset(); }

 private:
  std::string prefix_, stage_;
  std::optional<Progress> progress_;
};

}  // namespace overfly::cli
