#include <fcntl.h>
#include <fmt/format.h>
#include <sys/statvfs.h>
#include <sys/timex.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>

#include "capture/v4l2/list_cameras.h"
#include "daemon/cli/check.h"
#ifdef OVERFLY_HAS_LIBCAMERA
#include "capture/libcamera/libcamera_source.h"
#endif

namespace overfly::cli {
namespace {

using State = Check::State;

constexpr double kSlowDisk_mb_s =
    10;  // two updates of a 65 kB tile a second and the frames of a 20-MP camera
constexpr double kLittleSpace_gb = 4;

std::vector<std::filesystem::path> devices(const std::string& prefix) {
  std::vector<std::filesystem::path> out;
  std::error_code problem;
  for (const auto& entry : std::filesystem::directory_iterator("/dev", problem))
    if (entry.path().filename().string().starts_with(prefix)) out.push_back(entry.path());
  std::ranges::sort(out);
  return out;
}

std::string list(const std::vector<std::string>& names) {
  std::string out;
  for (const auto& name : names) out += (out.empty() ? "" : ", ") + name;
  return out;
}

// Megabytes a second that reach the disk; 0: cannot be written.
double writeSpeed(const std::filesystem::path& folder, std::string& problem) {
  auto name = (folder / ".doctor-XXXXXX").string();
  const int fd = mkstemp(name.data());
  if (fd < 0) {
    problem = std::strerror(errno);
    return 0;
  }
  unlink(name.c_str());
  constexpr std::size_t kBlock = 1u << 20, kBlocks = 32;
  const std::string block(kBlock, 'o');
  const auto begin = std::chrono::steady_clock::now();
  bool fine = true;
  for (std::size_t i = 0; i < kBlocks && fine; ++i)
    fine = write(fd, block.data(), block.size()) == static_cast<ssize_t>(block.size());
  fine = fine && fdatasync(fd) == 0;
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  if (!fine) problem = std::strerror(errno);
  close(fd);
  return fine ? static_cast<double>(kBlock * kBlocks) * 1e-6 / std::max(took.count(), 1e-6) : 0;
}

}  // namespace

void Check::worse(State to, const std::string& why, const std::string& what_to_do) {
  if (to <= state) return;
  state = to;
  finding = why;
  advice = what_to_do;
}

Check checkCameras(const config::Settings& settings) {
  Check out;
  out.name = "cameras";
  std::vector<std::string> found;
  std::string refused;
  for (const capture::v4l2::FoundCamera& camera : capture::v4l2::listCameras()) {
    if (camera.problem.empty())
      found.push_back(fmt::format("{} ({})", camera.card, camera.path));
    else
      refused = camera.problem;
  }
#ifdef OVERFLY_HAS_LIBCAMERA
  for (const capture::LibcameraCamera& camera : capture::libcameraCameras())
    found.push_back(fmt::format("{} (libcamera {})", camera.model, camera.id));
  out.add("libcamera", capture::libcameraVersion());
#else
  out.add("libcamera", "not in this build: libcamera-dev was not there");
#endif
  const auto media = devices("media");
  out.add("video devices", found);
  out.add("media controllers", media.size());
  out.finding = found.empty() ? "none" : list(found);
  const bool needs_one = settings.source.kind == config::SourceKind::V4l2 ||
                         settings.source.kind == config::SourceKind::Libcamera;
  if (!refused.empty())
    out.worse(State::Warning, refused, "run as the user overfly, or join the group that owns the device");
  if (needs_one && found.empty() && media.empty())
    out.worse(State::Problem, "none, and source.kind asks for one",
              "plug it in, and see that its driver is loaded (dmesg)");
  return out;
}

Check checkGpio(const config::Settings& settings) {
  Check out;
  out.name = "GPIO";
  std::vector<std::string> chips;
  bool asked_for = settings.gpio.chip.empty();
  bool usable = true;
  for (const auto& path : devices("gpiochip")) {
    const bool wanted = path == settings.gpio.chip || path.filename() == settings.gpio.chip;
    asked_for = asked_for || wanted;
    const bool readable = access(path.c_str(), R_OK | W_OK) == 0;
    if (wanted) usable = readable;
    chips.push_back(path.filename().string() + (readable ? "" : " (no permission)"));
  }
  out.add("chips", chips);
  out.finding = chips.empty() ? "no chips" : list(chips);
  if (settings.gpio.chip.empty()) {
    out.finding += "; gpio.chip is empty, so exposure and PPS are not stamped by hardware";
  } else if (!asked_for) {
    out.worse(State::Problem, "there is no " + settings.gpio.chip,
              "set gpio.chip to one of: " + (chips.empty() ? "none is there" : list(chips)));
  } else if (!usable) {
    out.worse(State::Problem, settings.gpio.chip + " may not be opened",
              "run as the user overfly, or join the group gpio");
  }
  return out;
}

Check checkDisk(const config::Settings& settings) {
  Check out;
  out.name = "disk";
  // The folder, or the nearest one above it that is there already.
  auto folder = settings.map.folder;
  std::error_code ignored;
  while (!folder.empty() && !std::filesystem::is_directory(folder, ignored) && folder != folder.parent_path())
    folder = folder.parent_path();
  if (folder.empty()) folder = ".";
  struct statvfs space {};
  const double free_gb = statvfs(folder.c_str(), &space) == 0 ? static_cast<double>(space.f_bavail) *
                                                                    static_cast<double>(space.f_frsize) * 1e-9
                                                              : 0;
  std::string problem;
  const double speed = writeSpeed(folder, problem);
  out.add("folder", settings.map.folder.string());
  out.add("free GB", std::round(free_gb * 10) / 10);
  out.add("write MB/s", std::round(speed));
  out.finding =
      fmt::format("{}: {:.1f} GB free, {:.0f} MB/s written through", folder.string(), free_gb, speed);
  if (speed <= 0)
    out.worse(State::Problem, "cannot write to " + folder.string() + ": " + problem,
              "make the folder writable for the user overfly, or change map.folder");
  if (free_gb < kLittleSpace_gb)
    out.worse(State::Warning, out.finding, "delete old missions, or let map.folder lie on a larger disk");
  if (speed > 0 && speed < kSlowDisk_mb_s)
    out.worse(State::Warning, out.finding,
              "frames and tiles will wait for the disk: use a faster card or an SSD");
  return out;
}

Check checkClock() {
  Check out;
  out.name = "clock";
  timex state{};
  const int code = adjtimex(&state);
  const bool synchronised = code >= 0 && code != TIME_ERROR && (state.status & STA_UNSYNC) == 0;
  out.add("synchronised", synchronised);
  out.add("largest error s", static_cast<double>(state.maxerror) * 1e-6);
  out.finding =
      fmt::format("synchronised, off by {:.0f} ms at most", static_cast<double>(state.maxerror) * 1e-3);
  if (!synchronised)
    out.worse(State::Warning, "not synchronised",
              "run chrony, with GPS or the autopilot's time where there is no network; frames stay in order "
              "without, but "
              "their dates may be wrong");
  return out;
}

}  // namespace overfly::cli
