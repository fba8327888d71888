#include "tests/unit/house/house_rules.h"

#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <sstream>

namespace overfly::house {
namespace fs = std::filesystem;
namespace {

struct Home {
  std::string header;                // what the included name begins with
  std::vector<std::string> folders;  // the only ones that may include it
};
const std::vector<Home> kHomes{
    {"GLES", {"render/gl/"}},       {"EGL/", {"render/gl/"}},
    {"GL/", {"render/gl/"}},        {"gbm.h", {"render/gl/"}},
    {"sqlite3", {"tiling/store/"}}, {"toml++", {"config/detail/", "render/scene/detail/"}}};

std::vector<fs::path> filesBelow(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code error;
  for (fs::recursive_directory_iterator i(folder, error), end; !error && i != end; i.increment(error)) {
    const std::string name = i->path().filename().string();
    if (i->is_directory() && (name == "build" || name == ".git" || name == "node_modules"))
      i.disable_recursion_pending();
    if (i->is_regular_file()) files.push_back(i->path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

std::string contentOf(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

// Position of the room in the order; kRooms.size() for what is no room.
std::size_t rankOf(const std::string& room) {
  return static_cast<std::size_t>(std::find(kRooms.begin(), kRooms.end(), room) - kRooms.begin());
}

bool isCode(const fs::path& file) {
  static const std::set<std::string> endings{".h", ".hpp", ".cpp", ".cc", ".c", ".inl", ".ipp"};
  return endings.count(file.extension().string()) > 0;
}

void checkInclude(const std::string& where, const std::string& file, const std::string& included,
                  std::size_t rank, std::vector<std::string>& out) {
  if (included.find("../") != std::string::npos || included.starts_with("./")) {
    out.push_back(where + ": includes \"" + included + "\" by a relative path; name it from the root");
    return;
  }
  const std::size_t other = rankOf(included.substr(0, included.find('/')));
  if (other < kRooms.size() && included.find('/') != std::string::npos && other > rank) {
    out.push_back(where + ": " + kRooms[rank] + " includes " + included + ", which stands above it");
  }
  for (const Home& home : kHomes) {
    const bool at_home = std::any_of(home.folders.begin(), home.folders.end(),
                                     [&](const std::string& folder) { return file.starts_with(folder); });
    if (included.starts_with(home.header) && !at_home) {
      out.push_back(where + ": includes " + included + ", which only " + home.folders.front() + " may");
    }
  }
}

}  // namespace

std::vector<std::string> includeBreaches(const fs::path& root) {
  static const std::regex include(R"re(^\s*#\s*include\s*[<"]([^>"]+)[>"])re");
  std::vector<std::string> out;
  for (std::size_t rank = 0; rank < kRooms.size(); ++rank) {
    for (const fs::path& path : filesBelow(root / kRooms[rank])) {
      if (!isCode(path)) continue;
      const std::string file = fs::relative(path, root).string();
      std::istringstream lines(contentOf(path));
      std::string line;
      for (int number = 1; std::getline(lines, line); ++number) {
        if (line.find("include") == std::string::npos || line.size() > 300) continue;
        std::smatch match;
        if (!std::regex_search(line, match, include)) continue;
        checkInclude(file + ":" + std::to_string(number), file, match[1].str(), rank, out);
      }
    }
  }
  return out;
}

std::vector<std::string> linkBreaches(const fs::path& root) {
  static const std::regex library(R"re(overfly_library\(\s*(\w+))re");
  static const std::regex linked(R"re(\boverfly_(\w+))re");
  std::map<std::string, std::size_t> rank_of_library;
  std::vector<std::pair<fs::path, std::size_t>> lists;
  for (std::size_t rank = 0; rank < kRooms.size(); ++rank) {
    for (const fs::path& path : filesBelow(root / kRooms[rank])) {
      if (path.filename() != "CMakeLists.txt") continue;
      lists.emplace_back(path, rank);
      const std::string text = contentOf(path);
      for (std::sregex_iterator i(text.begin(), text.end(), library), end; i != end; ++i)
        rank_of_library[(*i)[1]] = rank;
    }
  }
  std::vector<std::string> out;
  for (const auto& [path, rank] : lists) {
    std::istringstream lines(contentOf(path));
    std::string line;
    for (int number = 1; std::getline(lines, line); ++number) {
      line = line.substr(0, line.find('#'));
      for (std::sregex_iterator i(line.begin(), line.end(), linked), end; i != end; ++i) {
        const auto found = rank_of_library.find((*i)[1]);
        if (found == rank_of_library.end() || found->second <= rank) continue;
        out.push_back(fs::relative(path, root).string() + ":" + std::to_string(number) + ": " + kRooms[rank] +
                      " links " + (*i)[0].str() + " of " + kRooms[found->second] + ", which stands above it");
      }
    }
  }
  return out;
}

std::vector<std::string> scriptBreaches(const fs::path& root) {
  std::vector<std::string> out;
  for (const fs::path& path : filesBelow(root)) {
    std::ifstream in(path, std::ios::binary);
    std::string first(64, '\0');
    in.read(first.data(), static_cast<std::streamsize>(first.size()));
    first = first.substr(0, first.find('\n'));
    if (!first.starts_with("#!") || first.find("bash") == std::string::npos) continue;
    const std::string name = fs::relative(path, root).string();
    const std::string command = "bash -n '" + path.string() + "' 2>/dev/null";
    if (std::system(command.c_str()) != 0) out.push_back(name + ": bash -n refuses it");
    if (access(path.c_str(), X_OK) != 0) out.push_back(name + ": begins with #! and may not be executed");
  }
  return out;
}

}  // namespace overfly::house
