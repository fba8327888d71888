#pragma once
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "tests/integration/pull/program.h"

namespace overfly::test {

struct Picture {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgb;
};

// Headless Chromium by ChromeDriver (W3C WebDriver). Software rendering, and no name is ever resolved.
class Browser {
 public:
  // Null with the reason when there is none on this machine. `webgl`: false takes it away from all pages.
  static std::unique_ptr<Browser> start(int width, int height, std::string& problem, bool webgl = true);
  ~Browser();
  Browser(const Browser&) = delete;
  Browser& operator=(const Browser&) = delete;

  void open(const std::string& url);
  // The value of a script's `return`.
  nlohmann::json run(const std::string& script);
  [[nodiscard]] std::string screenshotPng();
  [[nodiscard]] Picture screenshot();
  void resize(int width, int height);
  // A finger from one place of the page to another, in CSS pixels; the same place is a tap.
  void drag(int from_x, int from_y, int to_x, int to_y);
  // Addresses of all requests since the last call.
  std::vector<std::string> requests();

 private:
  explicit Browser(std::unique_ptr<Program> driver, std::string base)
      : driver_(std::move(driver)), base_(std::move(base)) {}
  nlohmann::json command(const std::string& method, const std::string& path, const nlohmann::json& body = {});

  std::unique_ptr<Program> driver_;
  std::string base_;  // of the session
};

}  // namespace overfly::test
