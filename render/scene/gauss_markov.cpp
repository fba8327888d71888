#include "render/scene/gauss_markov.h"

#include <cmath>

#include "render/scene/random.h"

namespace overfly::scene {

std::vector<double> gaussMarkov(std::uint32_t seed, const std::vector<double>& times_s, double sigma,
                                double time_constant_s) {
  std::vector<double> values;
  values.reserve(times_s.size());
  double value = 0;
  for (std::size_t i = 0; i < times_s.size(); ++i) {
    const double kept = i == 0 ? 0 : std::exp(-(times_s[i] - times_s[i - 1]) / time_constant_s);
    value = kept * value + sigma * std::sqrt(1 - kept * kept) * normal(seed, static_cast<std::uint32_t>(i));
    values.push_back(value);
  }
  return values;
}

}  // namespace overfly::scene
