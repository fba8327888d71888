#pragma once
#include <cstdint>
#include <vector>

namespace overfly::scene {

// A first-order Gauss-Markov process (Ornstein-Uhlenbeck) sampled at rising times: stationary, standard
// deviation sigma, correlation exp(-dt / time_constant). Its one-sided power spectrum is
// 4 sigma^2 tau / (1 + (2 pi f tau)^2). The same seed gives the same path at the same times.
[[nodiscard]] std::vector<double> gaussMarkov(std::uint32_t seed, const std::vector<double>& times_s,
                                              double sigma, double time_constant_s);

}  // namespace overfly::scene
