#pragma once
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "config/settings.h"

namespace overfly::cli {

// One thing that `overfly doctor` looks at: a line for people, figures for programs.
struct Check {
  enum class State { Ok, Warning, Problem };  // Warning: maps all the same; Problem: does not map as set
  std::string name;
  State state = State::Ok;
  std::string finding;
  std::string advice;  // what to do, where something is to be done
  std::vector<std::pair<std::string, nlohmann::ordered_json>> facts;

  void add(std::string key, nlohmann::ordered_json value) {
    facts.emplace_back(std::move(key), std::move(value));
  }
  // Keeps the worst state and the first thing to do for it.
  void worse(State to, const std::string& why, const std::string& what_to_do);
};

// Each takes what the settings ask for and looks whether the machine has it. They change nothing; the disk's
// speed is measured with a file of 32 MB in the map's folder, which is removed again.
[[nodiscard]] Check checkCameras(const config::Settings& settings);
[[nodiscard]] Check checkGpio(const config::Settings& settings);
[[nodiscard]] Check checkDisk(const config::Settings& settings);
[[nodiscard]] Check checkClock();
// Listens for `seconds`. A port that overflyd holds is said to be in use.
[[nodiscard]] Check checkAutopilot(const config::Settings& settings, double seconds);

}  // namespace overfly::cli
