#include "capture/v4l2/detail/controls.h"

#include <linux/videodev2.h>

#include <algorithm>
#include <cmath>
#include <optional>

namespace overfly::capture::v4l2 {
namespace {

constexpr std::int64_t kExposureUnitNs = 100'000;  // of V4L2_CID_EXPOSURE_ABSOLUTE

std::optional<v4l2_queryctrl> find(const Node& node, __u32 id) {
  v4l2_queryctrl control{};
  control.id = id;
  if (node.call(VIDIOC_QUERYCTRL, control) != 0) return std::nullopt;
  if ((control.flags & (V4L2_CTRL_FLAG_DISABLED | V4L2_CTRL_FLAG_READ_ONLY)) != 0) return std::nullopt;
  return control;
}

bool set(const Node& node, __u32 id, std::int64_t value) {
  v4l2_control control{};
  control.id = id;
  control.value = static_cast<__s32>(value);
  return node.call(VIDIOC_S_CTRL, control) == 0;
}

// Within the control's range; nullopt where there is none or it refuses.
std::optional<int> setNear(const Node& node, __u32 id, double value) {
  const auto control = find(node, id);
  if (!control) return std::nullopt;
  const auto asked = std::clamp<std::int64_t>(std::llround(value), control->minimum, control->maximum);
  if (!set(node, id, asked)) return std::nullopt;
  v4l2_control now{};
  now.id = id;
  return node.call(VIDIOC_G_CTRL, now) == 0 ? now.value : static_cast<int>(asked);
}

}  // namespace

Controls setControls(const Node& node, const LiveCameraOptions& options) {
  Controls out;
  if (options.exposure_ns > 0) {
    (void)set(node, V4L2_CID_EXPOSURE_AUTO, V4L2_EXPOSURE_MANUAL);
    const auto units =
        setNear(node, V4L2_CID_EXPOSURE_ABSOLUTE, static_cast<double>(options.exposure_ns) / kExposureUnitNs);
    if (units) {
      out.exposure_ns = *units * kExposureUnitNs;
    } else {
      out.missing.emplace_back("no exposure control");
    }
  } else if (!set(node, V4L2_CID_EXPOSURE_AUTO, V4L2_EXPOSURE_AUTO)) {
    // USB cameras know only this kind of automatic.
    (void)set(node, V4L2_CID_EXPOSURE_AUTO, V4L2_EXPOSURE_APERTURE_PRIORITY);
  }
  (void)set(node, V4L2_CID_AUTOGAIN, options.gain > 0 ? 0 : 1);
  if (options.gain > 0 && !setNear(node, V4L2_CID_ANALOGUE_GAIN, options.gain) &&
      !setNear(node, V4L2_CID_GAIN, options.gain))
    out.missing.emplace_back("no gain control");
  (void)set(node, V4L2_CID_FOCUS_AUTO, 0);
  if (options.lens_position_dpt > 0) {
    out.missing.emplace_back("no focus in dioptres");
  } else if (const auto focus = find(node, V4L2_CID_FOCUS_ABSOLUTE)) {
    (void)set(node, V4L2_CID_FOCUS_ABSOLUTE, focus->minimum);  // larger is closer
  }
  return out;
}

}  // namespace overfly::capture::v4l2
