#include "daemon/tradeoff/svg_chart.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace overfly::tradeoff {
namespace {

constexpr double kWidth = 860, kHeight = 420, kLeft = 78, kRight = 24, kTop = 20, kBottom = 56;

// A logarithmic axis over values, with a little room at both ends.
struct LogAxis {
  double low, high, from, to;

  LogAxis(double least, double most, double at_least, double at_most) : from(at_least), to(at_most) {
    low = std::log10(least) - 0.06;
    high = std::log10(most) + 0.06;
    if (high - low < 0.3) low -= 0.15, high += 0.15;
  }
  [[nodiscard]] double at(double value) const {
    return from + (std::log10(value) - low) / (high - low) * (to - from);
  }
  [[nodiscard]] std::vector<double> ticks() const {
    std::vector<double> all;
    for (int power = static_cast<int>(std::floor(low)); power <= static_cast<int>(std::ceil(high)); ++power)
      for (const double digit : {1.0, 2.0, 5.0}) {
        const double value = digit * std::pow(10.0, power);
        if (std::log10(value) >= low && std::log10(value) <= high) all.push_back(value);
      }
    return all;
  }
};

}  // namespace

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        out += c;
    }
  return out;
}

std::string scatterChart(const std::string& x_title, const std::string& y_title,
                         const std::vector<ChartPoint>& all) {
  std::vector<ChartPoint> points;
  for (const ChartPoint& p : all)
    if (p.x > 0 && p.y > 0 && std::isfinite(p.x) && std::isfinite(p.y)) points.push_back(p);
  if (points.empty()) return "<p>Nothing to draw.</p>";
  std::sort(points.begin(), points.end(), [](const auto& a, const auto& b) { return a.x < b.x; });
  const auto [left, right] = std::minmax_element(points.begin(), points.end(),
                                                 [](const auto& a, const auto& b) { return a.x < b.x; });
  const auto [low, high] = std::minmax_element(points.begin(), points.end(),
                                               [](const auto& a, const auto& b) { return a.y < b.y; });
  const LogAxis x(left->x, right->x, kLeft, kWidth - kRight), y(low->y, high->y, kHeight - kBottom, kTop);
  std::string svg = fmt::format("<svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{} against {}\">",
                                kWidth, kHeight, escaped(y_title), escaped(x_title));
  for (const double tick : x.ticks())
    svg += fmt::format(
        "<line class=\"grid\" x1=\"{0:.1f}\" x2=\"{0:.1f}\" y1=\"{1}\" y2=\"{2}\"/>"
        "<text class=\"tick\" x=\"{0:.1f}\" y=\"{3}\" text-anchor=\"middle\">{4:g}</text>",
        x.at(tick), kTop, kHeight - kBottom, kHeight - kBottom + 18, tick);
  for (const double tick : y.ticks())
    svg += fmt::format(
        "<line class=\"grid\" x1=\"{1}\" x2=\"{2}\" y1=\"{0:.1f}\" y2=\"{0:.1f}\"/>"
        "<text class=\"tick\" x=\"{3}\" y=\"{4:.1f}\" text-anchor=\"end\">{5:g}</text>",
        y.at(tick), kLeft, kWidth - kRight, kLeft - 8, y.at(tick) + 4, tick);
  svg += fmt::format("<text class=\"title\" x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
                     0.5 * (kLeft + kWidth - kRight), kHeight - 12, escaped(x_title));
  svg += fmt::format(
      "<text class=\"title\" transform=\"translate(18 {}) rotate(-90)\" "
      "text-anchor=\"middle\">{}</text>",
      0.5 * (kTop + kHeight - kBottom), escaped(y_title));
  std::string line;
  for (const ChartPoint& p : points)
    if (p.emphasised) line += fmt::format("{:.1f},{:.1f} ", x.at(p.x), y.at(p.y));
  svg += "<polyline class=\"front\" points=\"" + line + "\"/>";
  for (const ChartPoint& p : points) {
    svg += fmt::format("<circle class=\"{}\" cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"{}\"><title>{}</title></circle>",
                       p.emphasised ? "best" : "other", x.at(p.x), y.at(p.y), p.emphasised ? 5 : 3.5,
                       escaped(p.label));
    if (p.is_default)
      svg += fmt::format(
          "<circle class=\"ring\" cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"10\"/>"
          "<text class=\"tick\" x=\"{:.1f}\" y=\"{:.1f}\">default</text>",
          x.at(p.x), y.at(p.y), x.at(p.x) + 13, y.at(p.y) - 8);
  }
  return svg + "</svg>";
}

std::string tornadoChart(std::vector<TornadoBar> bars) {
  if (bars.empty()) return "<p>Nothing to draw.</p>";
  const auto size = [](const TornadoBar& b) {
    return std::max(std::abs(std::log2(b.time_factor)), std::abs(std::log2(b.error_factor)));
  };
  std::erase_if(bars, [&](const TornadoBar& b) { return !std::isfinite(size(b)); });
  std::sort(bars.begin(), bars.end(), [&](const auto& a, const auto& b) { return size(a) > size(b); });
  double most = 1;
  for (const TornadoBar& b : bars) most = std::max(most, std::min(size(b), 4.0));
  constexpr double kRow = 30, kLabel = 210;
  const double height = kTop + kRow * static_cast<double>(bars.size()) + 44;
  const double centre = kLabel + 0.5 * (kWidth - kRight - kLabel), half = 0.5 * (kWidth - kRight - kLabel);
  const auto at = [&](double factor) {
    return centre + half * std::clamp(std::log2(factor) / most, -1.0, 1.0);
  };
  std::string svg = fmt::format(
      "<svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"change against the default\">", kWidth, height);
  for (int power = -4; power <= 4; ++power)
    if (std::abs(power) <= most + 1e-9)
      svg += fmt::format(
          "<line class=\"grid\" x1=\"{0:.1f}\" x2=\"{0:.1f}\" y1=\"{1}\" y2=\"{2}\"/>"
          "<text class=\"tick\" x=\"{0:.1f}\" y=\"{3}\" text-anchor=\"middle\">&#215;{4:g}</text>",
          at(std::exp2(power)), kTop, height - 44, height - 26, std::exp2(power));
  double y = kTop;
  for (const TornadoBar& bar : bars) {
    svg += fmt::format("<text class=\"tick\" x=\"{}\" y=\"{:.1f}\" text-anchor=\"end\">{}</text>",
                       kLabel - 10, y + 0.5 * kRow + 4, escaped(bar.label));
    const auto draw = [&](const char* kind, const char* what, double factor, double top) {
      const double a = std::min(centre, at(factor)), b = std::max(centre, at(factor));
      svg += fmt::format(
          "<rect class=\"{}\" x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"10\">"
          "<title>{}: {} &#215;{:.2f}</title></rect>",
          kind, a, top, std::max(b - a, 1.0), escaped(bar.label), what, factor);
    };
    draw("time", "time", bar.time_factor, y + 4);
    draw("error", "error", bar.error_factor, y + 15);
    y += kRow;
  }
  svg += fmt::format(
      "<rect class=\"time\" x=\"{0}\" y=\"{1:.1f}\" width=\"14\" height=\"10\"/>"
      "<text class=\"tick\" x=\"{2}\" y=\"{3:.1f}\">time</text>"
      "<rect class=\"error\" x=\"{4}\" y=\"{1:.1f}\" width=\"14\" height=\"10\"/>"
      "<text class=\"tick\" x=\"{5}\" y=\"{3:.1f}\">error</text>",
      kLabel, height - 16, kLabel + 20, height - 7, kLabel + 70, kLabel + 90);
  return svg + "</svg>";
}

}  // namespace overfly::tradeoff
