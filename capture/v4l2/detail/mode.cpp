#include "capture/v4l2/detail/mode.h"

#include <fmt/format.h>
#include <linux/videodev2.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <vector>

namespace overfly::capture::v4l2 {
namespace {

using Format = LiveCameraOptions::Format;

constexpr std::uint32_t kMostSizes = 256;  // of one format; a driver that never ends is not believed

__u32 typeOf(const Node& node) {
  return node.planes() ? V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE : V4L2_BUF_TYPE_VIDEO_CAPTURE;
}

struct Size {
  int width = 0, height = 0;
};

std::int64_t areaOf(const Size& size) { return std::int64_t{size.width} * size.height; }

bool fits(const Size& size, const LiveCameraOptions& asked) {
  return (asked.width == 0 || asked.width == size.width) &&
         (asked.height == 0 || asked.height == size.height);
}

// Of a range with steps: the asked value where it lies on one, else nothing.
std::optional<int> stepOf(__u32 low, __u32 high, __u32 step, int asked) {
  if (asked == 0) return static_cast<int>(high);
  const auto value = static_cast<__u32>(asked);
  if (value < low || value > high || (value - low) % std::max<__u32>(step, 1) != 0) return std::nullopt;
  return asked;
}

struct Offer {
  PixelLayout layout;
  std::vector<Size> sizes;           // those that fit first; empty: the driver does not say
  std::vector<std::string> as_text;  // all of them
};

Offer offerOf(const Node& node, const PixelLayout& layout, const LiveCameraOptions& asked) {
  Offer offer{layout, {}, {}};
  for (std::uint32_t i = 0; i < kMostSizes; ++i) {
    v4l2_frmsizeenum found{};
    found.index = i;
    found.pixel_format = layout.fourcc;
    if (node.call(VIDIOC_ENUM_FRAMESIZES, found) != 0) break;
    if (found.type == V4L2_FRMSIZE_TYPE_DISCRETE) {
      offer.sizes.push_back(
          {static_cast<int>(found.discrete.width), static_cast<int>(found.discrete.height)});
      offer.as_text.push_back(fmt::format("{}x{}", found.discrete.width, found.discrete.height));
      continue;
    }
    const auto& range = found.stepwise;
    offer.as_text.push_back(
        fmt::format("{}x{} to {}x{}", range.min_width, range.min_height, range.max_width, range.max_height));
    const auto width = stepOf(range.min_width, range.max_width, range.step_width, asked.width);
    const auto height = stepOf(range.min_height, range.max_height, range.step_height, asked.height);
    if (width && height) offer.sizes.push_back({*width, *height});
    break;
  }
  return offer;
}

std::vector<Offer> offersOf(const Node& node, const LiveCameraOptions& asked) {
  std::vector<std::uint32_t> codes;
  for (std::uint32_t i = 0; i < kMostSizes; ++i) {
    v4l2_fmtdesc found{};
    found.index = i;
    found.type = typeOf(node);
    if (node.call(VIDIOC_ENUM_FMT, found) != 0) break;
    codes.push_back(found.pixelformat);
  }
  std::vector<Offer> offers;
  for (const PixelLayout& layout : knownLayouts())
    if (std::find(codes.begin(), codes.end(), layout.fourcc) != codes.end())
      offers.push_back(offerOf(node, layout, asked));
  return offers;
}

std::string asText(const std::vector<Offer>& offers) {
  std::string text;
  for (const Offer& offer : offers) {
    const std::string line =
        fmt::format("{} {}", nameOf(offer.layout.format),
                    offer.as_text.empty() ? std::string("(its own size)")
                                          : fmt::format("{}", fmt::join(offer.as_text, ", ")));
    if (text.find(line) == std::string::npos) text += (text.empty() ? "" : "; ") + line;
  }
  return text.empty() ? "nothing that overfly can read" : text;
}

// The first plane's layout, from either API.
void readBack(const Node& node, const v4l2_format& format, Mode& mode) {
  __u32 colorspace = 0, quantization = 0;
  if (node.planes()) {
    const v4l2_pix_format_mplane& pix = format.fmt.pix_mp;
    mode.width = static_cast<int>(pix.width);
    mode.height = static_cast<int>(pix.height);
    mode.stride = static_cast<int>(pix.plane_fmt[0].bytesperline);
    colorspace = pix.colorspace, quantization = pix.quantization;
  } else {
    const v4l2_pix_format& pix = format.fmt.pix;
    mode.width = static_cast<int>(pix.width);
    mode.height = static_cast<int>(pix.height);
    mode.stride = static_cast<int>(pix.bytesperline);
    // The fields behind `priv` count only where the driver says so (V4L2_PIX_FMT_PRIV_MAGIC).
    colorspace = pix.colorspace;
    if (pix.priv == V4L2_PIX_FMT_PRIV_MAGIC) quantization = pix.quantization;
  }
  if (quantization == V4L2_QUANTIZATION_DEFAULT)
    quantization = V4L2_MAP_QUANTIZATION_DEFAULT(false, colorspace, V4L2_YCBCR_ENC_DEFAULT);
  mode.limited_range = quantization == V4L2_QUANTIZATION_LIM_RANGE &&
                       (mode.layout.format == Format::Nv12 || mode.layout.format == Format::Yuyv);
}

struct Answer {
  std::uint32_t fourcc = 0;
  unsigned planes = 1;
};

// Sets layout and size; what the driver made of it is in `mode`.
Result<Answer> trySet(const Node& node, const Size& size, Mode& mode) {
  v4l2_format format{};
  format.type = typeOf(node);
  if (const int error = node.call(VIDIOC_G_FMT, format); error != 0)
    return node.failed("say its picture format", error);
  Answer answer;
  if (node.planes()) {
    v4l2_pix_format_mplane& pix = format.fmt.pix_mp;
    pix.pixelformat = mode.layout.fourcc;
    pix.field = V4L2_FIELD_NONE;
    if (size.width > 0) pix.width = static_cast<__u32>(size.width);
    if (size.height > 0) pix.height = static_cast<__u32>(size.height);
    pix.plane_fmt[0] = {};
  } else {
    v4l2_pix_format& pix = format.fmt.pix;
    pix.pixelformat = mode.layout.fourcc;
    pix.field = V4L2_FIELD_NONE;
    if (size.width > 0) pix.width = static_cast<__u32>(size.width);
    if (size.height > 0) pix.height = static_cast<__u32>(size.height);
    pix.bytesperline = 0;
    pix.sizeimage = 0;
  }
  if (const int error = node.call(VIDIOC_S_FMT, format); error != 0)
    return node.failed("take its picture format", error);
  answer.fourcc = node.planes() ? format.fmt.pix_mp.pixelformat : format.fmt.pix.pixelformat;
  if (node.planes()) answer.planes = format.fmt.pix_mp.num_planes;
  readBack(node, format, mode);
  return answer;
}

double setRate(const Node& node, double asked) {
  v4l2_streamparm parameters{};
  parameters.type = typeOf(node);
  if (node.call(VIDIOC_G_PARM, parameters) != 0) return 0;
  v4l2_captureparm& capture = parameters.parm.capture;
  if (asked > 0 && (capture.capability & V4L2_CAP_TIMEPERFRAME) != 0) {
    capture.timeperframe = {1000, static_cast<__u32>(std::lround(1000 * asked))};
    (void)node.call(VIDIOC_S_PARM, parameters);
  }
  const v4l2_fract& time = capture.timeperframe;
  return time.numerator > 0 ? static_cast<double>(time.denominator) / time.numerator : 0;
}

}  // namespace

Result<Mode> setMode(const Node& node, const LiveCameraOptions& options) {
  std::vector<Offer> offers = offersOf(node, options);
  for (Offer& offer : offers) {
    if (options.format != Format::Auto && options.format != offer.layout.format) continue;
    std::erase_if(offer.sizes, [&](const Size& size) { return !fits(size, options); });
    // A driver that names no sizes is asked; one that names others cannot.
    if (offer.sizes.empty() && !offer.as_text.empty()) continue;
    const Size size =
        offer.sizes.empty()
            ? Size{options.width, options.height}
            : *std::max_element(offer.sizes.begin(), offer.sizes.end(),
                                [](const Size& a, const Size& b) { return areaOf(a) < areaOf(b); });
    Mode mode;
    mode.layout = offer.layout;
    const auto answer = trySet(node, size, mode);
    if (!answer) return tl::unexpected(answer.error());
    if (answer->fourcc != offer.layout.fourcc || answer->planes != 1 ||
        !fits({mode.width, mode.height}, options))
      continue;
    mode.rate_fps = setRate(node, options.rate_fps);
    return mode;
  }
  std::string asked = nameOf(options.format);
  if (options.width > 0 || options.height > 0)
    asked += fmt::format(" at {}x{}", options.width, options.height);
  return fail(ErrorCode::Unsupported,
              fmt::format("{} ({}) does not give {}; it gives {}: set camera.format, camera.width_px and "
                          "camera.height_px",
                          node.path(), node.card(), asked, asText(offers)));
}

}  // namespace overfly::capture::v4l2
