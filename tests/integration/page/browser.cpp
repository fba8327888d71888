#include "tests/integration/page/browser.h"

#include <png.h>

#include <stdexcept>

#include "tests/base64.h"
#include "tests/integration/link/client.h"

namespace overfly::test {
namespace {

constexpr const char* kDriver = "/usr/bin/chromedriver";
constexpr long kPatience_ms = 120000;  // software rendering on a busy machine

}  // namespace

std::unique_ptr<Browser> Browser::start(int width, int height, std::string& problem, bool webgl) {
  if (access(kDriver, X_OK) != 0 || access("/usr/bin/chromium", X_OK) != 0) {
    problem = "chromium and chromium-driver are not installed";
    return nullptr;
  }
  auto driver = std::make_unique<Program>(std::vector<std::string>{kDriver, "--port=0"});
  std::string port;
  const std::string said = "started successfully on port ";
  for (std::string line; !(line = driver->line(std::chrono::seconds(60))).empty();)
    if (const auto at = line.find(said); at != std::string::npos) {
      port = line.substr(at + said.size());
      break;
    }
  port = port.substr(0, port.find_first_not_of("0123456789"));
  const auto base = "http://127.0.0.1:" + port + "/session";
  std::vector<std::string> flags{"--headless=new",
                                 "--no-sandbox",
                                 "--disable-dev-shm-usage",
                                 "--hide-scrollbars",
                                 "--disable-extensions",
                                 "--disable-background-networking",
                                 "--no-first-run",
                                 "--force-device-scale-factor=1",
                                 "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1",
                                 "--window-size=" + std::to_string(width) + "," + std::to_string(height)};
  if (webgl)
    flags.insert(flags.end(),
                 {"--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"});
  else
    flags.insert(flags.end(), {"--disable-gpu", "--disable-3d-apis"});
  const nlohmann::json wanted{
      {"capabilities",
       {{"alwaysMatch",
         {{"browserName", "chrome"},
          {"goog:loggingPrefs", {{"performance", "ALL"}}},
          {"goog:chromeOptions", {{"binary", "/usr/bin/chromium"}, {"args", flags}}}}}}}};
  const auto answer = fetch(base, {"Content-Type: application/json"}, "POST", wanted.dump(), kPatience_ms);
  const auto node = nlohmann::json::parse(answer.body, nullptr, false);
  if (answer.status != 200 || !node.is_object()) {
    problem = "no session: " + answer.body.substr(0, 400);
    return nullptr;
  }
  std::unique_ptr<Browser> out(
      new Browser(std::move(driver), base + "/" + node["value"]["sessionId"].get<std::string>()));
  out->resize(width, height);
  return out;
}

Browser::~Browser() { fetch(base_, {}, "DELETE", {}, 20000); }

nlohmann::json Browser::command(const std::string& method, const std::string& path,
                                const nlohmann::json& body) {
  const auto answer =
      fetch(base_ + path, {"Content-Type: application/json"}, method,
            method == "POST" ? (body.is_null() ? "{}" : body.dump()) : std::string(), kPatience_ms);
  const auto node = nlohmann::json::parse(answer.body, nullptr, false);
  if (answer.status != 200 || !node.is_object())
    throw std::runtime_error("WebDriver " + path + ": " + answer.body.substr(0, 600));
  return node["value"];
}

void Browser::open(const std::string& url) { command("POST", "/url", {{"url", url}}); }

nlohmann::json Browser::run(const std::string& script) {
  return command("POST", "/execute/sync", {{"script", script}, {"args", nlohmann::json::array()}});
}

std::string Browser::screenshotPng() { return fromBase64(command("GET", "/screenshot").get<std::string>()); }

Picture Browser::screenshot() {
  const auto file = screenshotPng();
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  if (!png_image_begin_read_from_memory(&image, file.data(), file.size())) throw std::runtime_error("no PNG");
  image.format = PNG_FORMAT_RGB;
  Picture out{static_cast<int>(image.width), static_cast<int>(image.height), {}};
  out.rgb.resize(PNG_IMAGE_SIZE(image));
  png_image_finish_read(&image, nullptr, out.rgb.data(), 0, nullptr);
  return out;
}

void Browser::resize(int width, int height) {
  // The window's inner size is what a person sees; headless Chromium adds its own frame.
  command("POST", "/window/rect", {{"width", width}, {"height", height}});
  const auto inner = run("return [innerWidth, innerHeight]");
  command("POST", "/window/rect",
          {{"width", 2 * width - inner[0].get<int>()}, {"height", 2 * height - inner[1].get<int>()}});
}

void Browser::drag(int from_x, int from_y, int to_x, int to_y) {
  const auto move = [](int x, int y, int ms) {
    return nlohmann::json{{"type", "pointerMove"}, {"x", x}, {"y", y}, {"duration", ms}};
  };
  auto steps = nlohmann::json::array({move(from_x, from_y, 0), {{"type", "pointerDown"}, {"button", 0}}});
  if (from_x != to_x || from_y != to_y) steps.push_back(move(to_x, to_y, 300));
  steps.push_back({{"type", "pointerUp"}, {"button", 0}});
  const nlohmann::json finger{{"type", "pointer"},
                              {"id", "finger"},
                              {"parameters", {{"pointerType", "touch"}}},
                              {"actions", std::move(steps)}};
  command("POST", "/actions", {{"actions", nlohmann::json::array({finger})}});
}

std::vector<std::string> Browser::requests() {
  std::vector<std::string> out;
  for (const auto& entry : command("POST", "/se/log", {{"type", "performance"}})) {
    const auto message = nlohmann::json::parse(entry["message"].get<std::string>(), nullptr, false);
    if (!message.is_object() || message["message"]["method"] != "Network.requestWillBeSent") continue;
    out.push_back(message["message"]["params"]["request"]["url"].get<std::string>());
  }
  return out;
}

}  // namespace overfly::test
