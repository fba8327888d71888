#include "daemon/cli/progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <utility>

namespace overfly::cli {
namespace {

constexpr auto kRedraw = std::chrono::milliseconds(100);
constexpr std::uint64_t kBarWidth = 30;
constexpr std::uint64_t kPlainLines = 10;  // of a whole run, where stderr is no terminal

}  // namespace

Progress::Progress(std::string label, std::uint64_t total)
    : Progress(std::move(label), total, stderr, isatty(STDERR_FILENO) == 1) {}

Progress::Progress(std::string label, std::uint64_t total, std::FILE* out, bool terminal)
    : label_(std::move(label)), total_(total), out_(out), terminal_(terminal) {}

Progress::~Progress() { finish(); }

void Progress::update(std::uint64_t done, const std::string& note) {
  done_ = total_ > 0 ? std::min(done, total_) : done;
  if (terminal_) {
    const auto now = Clock::now();
    if (now - last_draw_ >= kRedraw) {
      last_draw_ = now;
      draw(note);
    }
    return;
  }
  const bool due = total_ > 0 ? done_ * kPlainLines >= next_line_ * total_ : done_ >= next_line_;
  if (!due) return;
  if (total_ > 0) {
    next_line_ = done_ * kPlainLines / total_ + 1;
  } else {
    while (next_line_ <= done_) next_line_ *= 10;
  }
  draw(note);
}

void Progress::draw(const std::string& note) {
  drawn_ = true;
  std::string line = label_ + ": ";
  if (total_ > 0) {
    if (terminal_) {
      const std::uint64_t filled = done_ * kBarWidth / total_;
      line += fmt::format("[{}{}] ", std::string(filled, '#'), std::string(kBarWidth - filled, '.'));
    }
    line += fmt::format("{} of {} ({} %)", done_, total_, done_ * 100 / total_);
    const std::chrono::duration<double> elapsed = Clock::now() - started_;
    if (terminal_ && done_ > 0 && done_ < total_ && elapsed.count() > 2) {
      const double left_s =
          elapsed.count() * static_cast<double>(total_ - done_) / static_cast<double>(done_);
      line += fmt::format(", {:.0f} s left", left_s);
    }
  } else {
    line += fmt::format("{}", done_);
  }
  if (!note.empty()) line += "  " + note;
  if (terminal_) {
    fmt::print(out_, "\r\x1b[K{}", line);
  } else {
    fmt::print(out_, "{}\n", line);
  }
  std::fflush(out_);
}

void Progress::finish() {
  if (finished_) return;
  finished_ = true;
  if (!terminal_ || !drawn_) return;  // a plain log ends with its last line
  draw({});
  fmt::print(out_, "\n");
  std::fflush(out_);
}

}  // namespace overfly::cli
