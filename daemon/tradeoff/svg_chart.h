#pragma once
#include <string>
#include <vector>

namespace overfly::tradeoff {

// Charts as inline SVG. They carry no colours of their own: the page's style sheet gives them by class, so
// that one picture serves a dark and a light page.

struct ChartPoint {
  double x = 0, y = 0;      // above 0; others are left out
  std::string label;        // shown when a pointer rests on it
  bool emphasised = false;  // on the front: filled, and joined by a line in the order of x
  bool is_default = false;  // ringed
};

// Both axes logarithmic, with ticks at 1, 2 and 5 times the powers of ten.
[[nodiscard]] std::string scatterChart(const std::string& x_title, const std::string& y_title,
                                       const std::vector<ChartPoint>& points);

struct TornadoBar {
  std::string label;
  double time_factor = 1, error_factor = 1;  // against the default; 1: no change
};

// Two bars a row, to the left what is less and to the right what is more than the default, logarithmic; long
// bars first.
[[nodiscard]] std::string tornadoChart(std::vector<TornadoBar> bars);

// Text safe inside HTML and SVG.
[[nodiscard]] std::string escaped(const std::string& text);

}  // namespace overfly::tradeoff
