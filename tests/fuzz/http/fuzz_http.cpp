#include <cstdlib>
#include <sstream>
#include <string>

#include "daemon/link/detail/parse.h"
#include "daemon/link/detail/routes.h"
#include "tests/integration/link/made_map.h"

// Any text as a request to a real map: "METHOD PATH", then "name=value" lines for the query and "name: value"
// lines for headers. Every route answers with a status; nothing but a broken assumption is a 500.
//   build/fuzz/tests/fuzz/http/fuzz_http -max_total_time=60 tests/fuzz/http/corpus
namespace {

using namespace overfly;

class Link {
 public:
  Link()
      : folder_(makeFolder()),
        map_(folder_ / "made.overfly", geo::TileKey{18, 137001, 87001}, 2),
        routes_(
            options_, link::showMaps({{"made", "Made-up map", map_.path(), 0, false, true}}), events_, false,
            false, [] { return link::HttpCounters{}; }, [] { return std::string("127.0.0.1"); }, [] {}) {
    map_.makeAll();
    map_.addFrames(8);
  }
  ~Link() {
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  link::Response answer(const link::Request& request) { return routes_.answer(request); }

 private:
  static std::filesystem::path makeFolder() {
    std::string pattern = std::filesystem::temp_directory_path() / "overfly-fuzz-XXXXXX";
    return mkdtemp(pattern.data());
  }
  std::filesystem::path folder_;
  test::MadeMap map_;
  link::LinkOptions options_;
  link::EventHub events_;
  link::Routes routes_;
};

link::Request parse(const std::string& text) {
  link::Request out;
  std::istringstream in(text);
  std::string line;
  std::getline(in, line);
  const auto space = line.find(' ');
  const auto method = line.substr(0, space);
  out.method = method == "GET"      ? link::Method::Get
               : method == "DELETE" ? link::Method::Delete
               : method == "POST"   ? link::Method::Post
                                    : link::Method::Other;
  out.path = space == std::string::npos ? "/" : line.substr(space + 1);
  while (std::getline(in, line)) {
    const auto at = line.find_first_of("=:");
    if (at == std::string::npos) {
      out.body += line;
    } else if (line[at] == '=') {
      out.query[line.substr(0, at)] = line.substr(at + 1);
    } else {
      out.headers[line.substr(0, at)] = line.substr(std::min(line.size(), at + 2));
    }
  }
  return out;
}

// What reads a client's text must give the same again from its own.
void checkRoundTrips(const std::string& text) {
  if (const auto place = link::parseBundlePlace(text)) {
    const auto again = link::parseBundlePlace(link::text(*place));
    if (!again || again->bytes != place->bytes || !(again->cursor == place->cursor)) std::abort();
  }
  if (const auto wanted = link::parseWanted(text))
    for (const auto& one : *wanted)
      if (const auto again = link::parseWanted(link::text(one));
          !again || again->size() != 1 || again->front().key != one.key)
        std::abort();
  if (const auto split = link::splitTokenPath(text))
    if (split->rest.empty() || split->rest.front() != '/') std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static Link link;
  const std::string text(reinterpret_cast<const char*>(data), size);
  checkRoundTrips(text);
  const auto request = parse(text);
  for (const auto& [name, value] : request.query) checkRoundTrips(value);
  const auto response = link.answer(request);
  if (response.status < 200 || response.status > 599 || response.status == 500) std::abort();
  return 0;
}
