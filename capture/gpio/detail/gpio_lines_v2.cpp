// libgpiod 2.x (Debian 13, bookworm-backports).
#include <gpiod.h>

#include <cerrno>

#include "capture/gpio/detail/gpio_errors.h"
#include "capture/gpio/gpio_lines.h"

namespace overfly::capture {
namespace {

constexpr const char* kConsumer = "overfly";
constexpr std::size_t kEvents = 64;

template <auto Free>
struct Freed {
  template <class T>
  void operator()(T* pointer) const {
    Free(pointer);
  }
};
using Chip = std::unique_ptr<gpiod_chip, Freed<gpiod_chip_close>>;
using Request = std::unique_ptr<gpiod_line_request, Freed<gpiod_line_request_release>>;
using Settings = std::unique_ptr<gpiod_line_settings, Freed<gpiod_line_settings_free>>;
using LineConfig = std::unique_ptr<gpiod_line_config, Freed<gpiod_line_config_free>>;
using RequestConfig = std::unique_ptr<gpiod_request_config, Freed<gpiod_request_config_free>>;
using ChipInfo = std::unique_ptr<gpiod_chip_info, Freed<gpiod_chip_info_free>>;
using LineInfo = std::unique_ptr<gpiod_line_info, Freed<gpiod_line_info_free>>;
using Buffer = std::unique_ptr<gpiod_edge_event_buffer, Freed<gpiod_edge_event_buffer_free>>;

Result<Chip> openChip(const std::string& path, const std::vector<unsigned>& lines) {
  Chip chip(gpiod_chip_open(path.c_str()));
  if (!chip) return detail::chipFailure(path, errno);
  const ChipInfo info(gpiod_chip_get_info(chip.get()));
  if (!info) return detail::chipFailure(path, errno);
  const auto count = static_cast<unsigned>(gpiod_chip_info_get_num_lines(info.get()));
  for (const unsigned line : lines)
    if (line >= count) return detail::noSuchLine(path, line, count);
  return chip;
}

Result<Request> request(const Chip& chip, const std::string& path, const LineConfig& config,
                        const std::vector<unsigned>& lines) {
  const RequestConfig options(gpiod_request_config_new());
  gpiod_request_config_set_consumer(options.get(), kConsumer);
  Request made(gpiod_chip_request_lines(chip.get(), options.get(), config.get()));
  if (made) return made;
  const int code = errno;
  for (const unsigned line : lines) {
    const LineInfo info(gpiod_chip_get_line_info(chip.get(), line));
    if (!info || !gpiod_line_info_is_used(info.get())) continue;
    const char* user = gpiod_line_info_get_consumer(info.get());
    return detail::lineFailure(path, line, code, user != nullptr ? user : "");
  }
  return detail::lineFailure(path, lines.front(), code, "");
}

class EdgeLines2 final : public EdgeLines {
 public:
  EdgeLines2(Request request, std::string path)
      : request_(std::move(request)), path_(std::move(path)), buffer_(gpiod_edge_event_buffer_new(kEvents)) {}

  Result<std::vector<GpioEdge>> wait(std::chrono::milliseconds timeout) override {
    std::vector<GpioEdge> edges;
    const int ready =
        gpiod_line_request_wait_edge_events(request_.get(), std::int64_t{timeout.count()} * 1'000'000);
    if (ready < 0 && errno != EINTR) return detail::chipGone(path_, errno);
    if (ready <= 0) return edges;
    const int count = gpiod_line_request_read_edge_events(request_.get(), buffer_.get(), kEvents);
    if (count < 0) return detail::chipGone(path_, errno);
    const std::int64_t shift = detail::boottimeFromMonotonic(), now = detail::boottimeNow();
    for (int i = 0; i < count; ++i) {
      gpiod_edge_event* event =
          gpiod_edge_event_buffer_get_event(buffer_.get(), static_cast<unsigned long>(i));
      edges.push_back({now, gpiod_edge_event_get_line_offset(event),
                       gpiod_edge_event_get_event_type(event) == GPIOD_EDGE_EVENT_RISING_EDGE,
                       static_cast<std::uint32_t>(gpiod_edge_event_get_line_seqno(event)),
                       static_cast<std::int64_t>(gpiod_edge_event_get_timestamp_ns(event)) + shift});
    }
    return edges;
  }

 private:
  Request request_;
  std::string path_;
  Buffer buffer_;
};

class OutputLine2 final : public OutputLine {
 public:
  OutputLine2(Request request, std::string path, unsigned line)
      : request_(std::move(request)), path_(std::move(path)), line_(line) {}
  Result<void> set(bool high) override {
    const auto value = high ? GPIOD_LINE_VALUE_ACTIVE : GPIOD_LINE_VALUE_INACTIVE;
    if (gpiod_line_request_set_value(request_.get(), line_, value) != 0)
      return detail::lineFailure(path_, line_, errno, "");
    return {};
  }

 private:
  Request request_;
  std::string path_;
  unsigned line_;
};

}  // namespace

Result<std::unique_ptr<EdgeLines>> EdgeLines::open(const std::string& chip,
                                                   const std::vector<LineWanted>& lines) {
  const std::string path = detail::chipPath(chip);
  std::vector<unsigned> numbers;
  for (const LineWanted& line : lines) numbers.push_back(line.line);
  auto opened = openChip(path, numbers);
  if (!opened) return tl::unexpected(opened.error());
  const LineConfig config(gpiod_line_config_new());
  for (const LineWanted& line : lines) {
    const Settings settings(gpiod_line_settings_new());
    gpiod_line_settings_set_direction(settings.get(), GPIOD_LINE_DIRECTION_INPUT);
    gpiod_line_settings_set_edge_detection(settings.get(),
                                           line.rising ? GPIOD_LINE_EDGE_RISING : GPIOD_LINE_EDGE_FALLING);
    gpiod_line_settings_set_event_clock(settings.get(), GPIOD_LINE_CLOCK_MONOTONIC);
    if (gpiod_line_config_add_line_settings(config.get(), &line.line, 1, settings.get()) != 0)
      return detail::lineFailure(path, line.line, errno, "");
  }
  auto requested = request(*opened, path, config, numbers);
  if (!requested) return tl::unexpected(requested.error());
  return std::make_unique<EdgeLines2>(std::move(*requested), path);
}

Result<std::unique_ptr<OutputLine>> OutputLine::open(const std::string& chip, unsigned line) {
  const std::string path = detail::chipPath(chip);
  auto opened = openChip(path, {line});
  if (!opened) return tl::unexpected(opened.error());
  const LineConfig config(gpiod_line_config_new());
  const Settings settings(gpiod_line_settings_new());
  gpiod_line_settings_set_direction(settings.get(), GPIOD_LINE_DIRECTION_OUTPUT);
  gpiod_line_settings_set_output_value(settings.get(), GPIOD_LINE_VALUE_INACTIVE);
  if (gpiod_line_config_add_line_settings(config.get(), &line, 1, settings.get()) != 0)
    return detail::lineFailure(path, line, errno, "");
  auto requested = request(*opened, path, config, {line});
  if (!requested) return tl::unexpected(requested.error());
  return std::make_unique<OutputLine2>(std::move(*requested), path, line);
}

const char* gpioLibrary() { return "2"; }

}  // namespace overfly::capture
