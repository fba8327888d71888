#pragma once
#include <cmath>
#include <cstring>
#include <random>

#include "capture/pose/mavlink/codec.h"

namespace overfly::mavlink {

// Any values in all fields; about every fourth field is zero, so that truncation is met; floats are finite.
template <class M>
M randomMessage(std::mt19937_64& random) {
  M message;
  const auto fill = [&](auto& value) {
    using T = std::decay_t<decltype(value)>;
    if constexpr (std::is_floating_point_v<T>) {
      value = static_cast<T>(std::uniform_real_distribution<double>(-1e4, 1e4)(random));
    } else {
      const std::uint64_t bits = random();
      std::memcpy(&value, &bits, sizeof value);
    }
  };
  M::fields(message, [&]<class F>(std::string_view, F& field) {
    const bool zero = random() % 4 == 0;
    if constexpr (requires { field.size(); }) {
      for (auto& element : field) {
        if constexpr (std::is_same_v<std::decay_t<decltype(element)>, char>) {
          element = zero ? '\0' : static_cast<char>('a' + random() % 26);
        } else if (zero) {
          element = {};
        } else {
          fill(element);
        }
      }
    } else if (zero) {
      field = {};
    } else {
      fill(field);
    }
  });
  return message;
}

// Calls `f` with a type_identity of each message in turn.
template <class F>
void forEachMessage(F&& f) {
  [&]<class... M>(std::type_identity<std::tuple<M...>>) {
    (f(std::type_identity<M>{}), ...);
  }(std::type_identity<Messages>{});
}

// A packet of a random message of messages.h.
inline std::vector<std::uint8_t> randomPacket(std::mt19937_64& random, Address from, std::uint8_t sequence) {
  std::vector<std::uint8_t> packet;
  const std::size_t wanted = random() % std::tuple_size_v<Messages>;
  std::size_t i = 0;
  forEachMessage([&]<class M>(std::type_identity<M>) {
    if (i++ == wanted) packet = encode(randomMessage<M>(random), from, sequence);
  });
  return packet;
}

}  // namespace overfly::mavlink
