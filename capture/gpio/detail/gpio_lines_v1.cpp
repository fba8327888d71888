// libgpiod 1.6 (Debian 12).
#include <gpiod.h>
#include <poll.h>

#include <cerrno>

#include "capture/gpio/detail/gpio_errors.h"
#include "capture/gpio/gpio_lines.h"

namespace overfly::capture {
namespace {

constexpr const char* kConsumer = "overfly";

struct CloseChip {
  void operator()(gpiod_chip* chip) const { gpiod_chip_close(chip); }
};
using Chip = std::unique_ptr<gpiod_chip, CloseChip>;

Result<Chip> openChip(const std::string& path) {
  Chip chip(gpiod_chip_open(path.c_str()));
  if (!chip) return detail::chipFailure(path, errno);
  return chip;
}

Result<gpiod_line*> lineOf(const Chip& chip, const std::string& path, unsigned line) {
  if (line >= gpiod_chip_num_lines(chip.get()))
    return detail::noSuchLine(path, line, gpiod_chip_num_lines(chip.get()));
  gpiod_line* found = gpiod_chip_get_line(chip.get(), line);
  if (found == nullptr) return detail::lineFailure(path, line, errno, "");
  return found;
}

std::string userOf(gpiod_line* line) {
  const char* user = gpiod_line_consumer(line);
  return user != nullptr ? user : "";
}

class EdgeLines1 final : public EdgeLines {
 public:
  EdgeLines1(Chip chip, std::string path) : chip_(std::move(chip)), path_(std::move(path)) {}

  Result<void> add(const LineWanted& wanted) {
    auto line = lineOf(chip_, path_, wanted.line);
    if (!line) return tl::unexpected(line.error());
    const int status = wanted.rising ? gpiod_line_request_rising_edge_events(*line, kConsumer)
                                     : gpiod_line_request_falling_edge_events(*line, kConsumer);
    if (status != 0) return detail::lineFailure(path_, wanted.line, errno, userOf(*line));
    lines_.push_back({*line, wanted.line, 0});
    waits_.push_back({gpiod_line_event_get_fd(*line), POLLIN, 0});
    return {};
  }

  Result<std::vector<GpioEdge>> wait(std::chrono::milliseconds timeout) override {
    const int ready = ::poll(waits_.data(), waits_.size(), static_cast<int>(timeout.count()));
    if (ready < 0 && errno != EINTR) return detail::chipGone(path_, errno);
    std::vector<GpioEdge> edges;
    if (ready <= 0) return edges;
    const std::int64_t shift = detail::boottimeFromMonotonic(), now = detail::boottimeNow();
    for (std::size_t i = 0; i < lines_.size(); ++i) {
      if (waits_[i].revents == 0) continue;
      gpiod_line_event events[16];
      const int count = gpiod_line_event_read_multiple(lines_[i].line, events, 16);
      if (count < 0) return detail::chipGone(path_, errno);
      for (int k = 0; k < count; ++k) {
        const std::int64_t stamp = std::int64_t{events[k].ts.tv_sec} * 1'000'000'000 + events[k].ts.tv_nsec;
        edges.push_back({now, lines_[i].number, events[k].event_type == GPIOD_LINE_EVENT_RISING_EDGE,
                         ++lines_[i].count, stamp + shift});
      }
    }
    return edges;
  }

 private:
  struct Line {
    gpiod_line* line;  // the chip's
    unsigned number;
    std::uint32_t count;  // version 1 of the kernel's interface has no numbers of its own
  };
  Chip chip_;
  std::string path_;
  std::vector<Line> lines_;
  std::vector<pollfd> waits_;
};

class OutputLine1 final : public OutputLine {
 public:
  OutputLine1(Chip chip, std::string path, gpiod_line* line, unsigned number)
      : chip_(std::move(chip)), path_(std::move(path)), line_(line), number_(number) {}
  Result<void> set(bool high) override {
    if (gpiod_line_set_value(line_, high ? 1 : 0) != 0) return detail::lineFailure(path_, number_, errno, "");
    return {};
  }

 private:
  Chip chip_;
  std::string path_;
  gpiod_line* line_;
  unsigned number_;
};

}  // namespace

Result<std::unique_ptr<EdgeLines>> EdgeLines::open(const std::string& chip,
                                                   const std::vector<LineWanted>& lines) {
  const std::string path = detail::chipPath(chip);
  auto opened = openChip(path);
  if (!opened) return tl::unexpected(opened.error());
  auto edges = std::make_unique<EdgeLines1>(std::move(*opened), path);
  for (const LineWanted& line : lines)
    if (auto ok = edges->add(line); !ok) return tl::unexpected(ok.error());
  return edges;
}

Result<std::unique_ptr<OutputLine>> OutputLine::open(const std::string& chip, unsigned line) {
  const std::string path = detail::chipPath(chip);
  auto opened = openChip(path);
  if (!opened) return tl::unexpected(opened.error());
  auto found = lineOf(*opened, path, line);
  if (!found) return tl::unexpected(found.error());
  if (gpiod_line_request_output(*found, kConsumer, 0) != 0)
    return detail::lineFailure(path, line, errno, userOf(*found));
  return std::make_unique<OutputLine1>(std::move(*opened), path, *found, line);
}

const char* gpioLibrary() { return "1.6"; }

}  // namespace overfly::capture
