#include "config/load.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <fstream>
#include <iterator>
#include <utility>

#include "config/description.h"
#include "config/detail/check.h"
#include "config/detail/nearest.h"
#include "config/detail/toml_reader.h"

extern "C" char** environ;  // NOLINT(readability-identifier-naming): POSIX's name

namespace overfly::config {
namespace {

constexpr std::uintmax_t kLargestFile = 1 << 20;  // bytes; a settings file is some kilobytes

std::string unknownSection(std::string_view section) {
  std::vector<std::string> names;
  for (const SectionInfo& info : description()) names.push_back(info.name);
  if (const auto near = detail::nearest(section, names))
    return fmt::format("no such section; did you mean [{}]?", *near);
  return fmt::format("no such section; there are: {}", fmt::join(names, ", "));
}

std::string unknownKey(std::string_view section, std::string_view name) {
  if (const auto near = detail::nearestKey(section, name)) {
    const std::string unit = unitInWords(*near);
    return fmt::format("no such key; did you mean {}{}?", *near, unit.empty() ? "" : " (in " + unit + ")");
  }
  std::vector<std::string> names;
  if (const SectionInfo* info = findSection(section)) {
    for (const Key& key : info->keys) names.push_back(key.name);
  }
  return fmt::format("no such key; [{}] has: {}", section, fmt::join(names, ", "));
}

// Gathers settings and problems while one source after the other is read.
class Loader {
 public:
  void addFile(const std::filesystem::path& path) {
    std::error_code error;
    const std::uintmax_t size = std::filesystem::file_size(path, error);
    if (error) return problem({path.string(), 0}, "", "cannot be read: " + error.message());
    if (size > kLargestFile) {
      return problem({path.string(), 0}, "", fmt::format("found {} bytes, allowed {}", size, kLargestFile));
    }
    std::ifstream file(path, std::ios::binary);
    const std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
    if (!file) return problem({path.string(), 0}, "", "cannot be read: permission denied or not a file");
    addText(text, path.string());
  }

  void addText(std::string_view text, const std::string& name) {
    const detail::TomlText toml = detail::readToml(text);
    Problems found;
    std::swap(found, problems_);  // this text's own come by line behind those of earlier sources
    for (const detail::TomlFault& fault : toml.faults) addFault(fault, name);
    for (const detail::TomlSection& section : toml.sections) {
      if (findSection(section.name) == nullptr) {
        problem({name, section.line}, "[" + section.name + "]", unknownSection(section.name));
      }
    }
    for (const detail::TomlEntry& entry : toml.entries) addEntry(entry, name);
    std::stable_sort(problems_.begin(), problems_.end(),
                     [](const Problem& a, const Problem& b) { return a.origin.line < b.origin.line; });
    problems_.insert(problems_.begin(), std::make_move_iterator(found.begin()),
                     std::make_move_iterator(found.end()));
  }

  // Sections have one word, so the first underscore behind the prefix ends the section's name. Variables of a
  // section that does not exist belong to somebody else (build, tests).
  void addEnvironment(const std::string& name, const std::string& value) {
    constexpr std::string_view kPrefix = "OVERFLY_";
    if (!name.starts_with(kPrefix)) return;
    std::string lower = name.substr(kPrefix.size());
    std::transform(lower.begin(), lower.end(), lower.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    const auto underscore = lower.find('_');
    if (underscore == std::string::npos || findSection(lower.substr(0, underscore)) == nullptr) return;
    setFromText(lower.substr(0, underscore), lower.substr(underscore + 1), value, {"environment " + name, 0});
  }

  void addOverride(const std::string& assignment) {
    const Origin origin{"--set " + assignment, 0};
    const auto equals = assignment.find('=');
    const auto dot = assignment.find('.');
    if (equals == std::string::npos || dot == std::string::npos || dot > equals) {
      return problem(origin, "", "allowed is section.key=value");
    }
    const std::string section = assignment.substr(0, dot);
    if (findSection(section) == nullptr) return problem(origin, "[" + section + "]", unknownSection(section));
    setFromText(section, assignment.substr(dot + 1, equals - dot - 1), assignment.substr(equals + 1), origin);
  }

  tl::expected<Loaded, Problems> finish() {
    if (problems_.empty()) checkTogether();
    if (!problems_.empty()) return tl::unexpected(std::move(problems_));
    return std::move(loaded_);
  }

 private:
  void problem(Origin origin, std::string key, std::string message) {
    problems_.push_back({std::move(origin), std::move(key), std::move(message)});
  }

  void addFault(const detail::TomlFault& fault, const std::string& file) {
    constexpr std::size_t kShown = 60;
    const std::string found =
        fault.found.size() <= kShown ? fault.found : fault.found.substr(0, kShown) + "…";
    const Key* key = findKey(fault.section, fault.key);
    const std::string path = key != nullptr ? key->path() : std::string();
    problem({file, fault.line}, path,
            fmt::format("not TOML: found {}, allowed {} ({})", found.empty() ? "nothing" : found,
                        key != nullptr ? allowed(*key) : "[section], or key = value with texts in quotes",
                        fault.message));
  }

  void addEntry(const detail::TomlEntry& entry, const std::string& file) {
    const Origin origin{file, entry.line};
    if (entry.key.empty()) {
      return problem(origin, "[" + entry.section + "]",
                     fmt::format("found a list of tables, allowed one section [{}]", entry.section));
    }
    if (entry.section.empty()) {
      if (findSection(entry.key) != nullptr) {
        return problem(
            origin, "[" + entry.key + "]",
            fmt::format("found {}, allowed a section [{}]", detail::foundText(entry.value), entry.key));
      }
      const auto near = detail::nearestKey("", entry.key);
      return problem(
          origin, entry.key,
          "stands outside of any [section]" + (near ? "; did you mean " + *near + "?" : std::string()));
    }
    if (findSection(entry.section) == nullptr) return;  // told once, at the section
    const Key* key = findKey(entry.section, entry.key);
    if (key == nullptr) {
      return problem(origin, entry.section + "." + entry.key, unknownKey(entry.section, entry.key));
    }
    set(*key, entry.value, origin);
  }

  void setFromText(const std::string& section, const std::string& name, const std::string& text,
                   const Origin& origin) {
    const Key* key = findKey(section, name);
    if (key == nullptr) return problem(origin, section + "." + name, unknownKey(section, name));
    set(*key, detail::rawFromText(*key, text), origin);
  }

  void set(const Key& key, const detail::Raw& raw, const Origin& origin) {
    auto value = detail::check(key, raw);
    if (!value) return problem(origin, key.path(), value.error());
    key.set(loaded_.settings, *value);
    loaded_.origins[key.path()] = origin;
  }

  // What keys ask of each other. Told where the key that comes first in the list was set, else the next one.
  void checkTogether() {
    const Settings& s = loaded_.settings;
    const auto require = [&](bool holds, std::initializer_list<const char*> keys,
                             const std::string& message) {
      if (holds) return;
      Origin origin;
      for (const char* key : keys) {
        const auto found = loaded_.origins.find(key);
        if (found == loaded_.origins.end()) continue;
        origin = found->second;
        break;
      }
      problem(origin, *keys.begin(), message);
    };
    require(s.sweep.min_parallax_deg < s.sweep.max_parallax_deg,
            {"sweep.min_parallax_deg", "sweep.max_parallax_deg"},
            fmt::format("found {}, allowed less than sweep.max_parallax_deg, which is {}",
                        s.sweep.min_parallax_deg, s.sweep.max_parallax_deg));
    require(s.sweep.prefer != Prefer::MaxAge || s.sweep.max_age_s > 0, {"sweep.max_age_s", "sweep.prefer"},
            "found 0, allowed more than 0 with sweep.prefer = \"max_age\"");
    require(s.link.tls_certificate.empty() == s.link.tls_key.empty(),
            {"link.tls_certificate", "link.tls_key"},
            "found only one of link.tls_certificate and link.tls_key, allowed both or neither");
  }

  Loaded loaded_;
  Problems problems_;
};

}  // namespace

std::string Problem::text() const {
  std::string out = origin.source;
  if (origin.line > 0) out += fmt::format(":{}", origin.line);
  if (!out.empty()) out += ": ";
  if (!key.empty()) out += key + ": ";
  return out + message;
}

Sources installedSources(const std::filesystem::path& etc,
                         const std::optional<std::filesystem::path>& only_file) {
  Sources sources;
  if (only_file) {
    sources.files.push_back(*only_file);
  } else {
    std::error_code error;
    if (std::filesystem::exists(etc / "overfly.toml", error)) sources.files.push_back(etc / "overfly.toml");
    std::vector<std::filesystem::path> more;
    for (std::filesystem::directory_iterator i(etc / "conf.d", error), end; !error && i != end;
         i.increment(error)) {
      const std::string name = i->path().filename().string();
      if (name.ends_with(".toml") && !name.starts_with('.')) more.push_back(i->path());
    }
    std::sort(more.begin(), more.end());
    sources.files.insert(sources.files.end(), more.begin(), more.end());
  }
  for (char** variable = environ; variable != nullptr && *variable != nullptr; ++variable) {
    const std::string_view text(*variable);
    const auto equals = text.find('=');
    if (equals == std::string_view::npos) continue;
    sources.environment.emplace_back(text.substr(0, equals), text.substr(equals + 1));
  }
  return sources;
}

tl::expected<Loaded, Problems> load(const Sources& sources) {
  Loader loader;
  for (const auto& file : sources.files) loader.addFile(file);
  for (const auto& [name, value] : sources.environment) loader.addEnvironment(name, value);
  for (const std::string& assignment : sources.overrides) loader.addOverride(assignment);
  return loader.finish();
}

tl::expected<Loaded, Problems> loadText(std::string_view toml, const std::string& name) {
  Loader loader;
  loader.addText(toml, name);
  return loader.finish();
}

Error errorFrom(const Problems& problems) {
  std::string message;
  for (const Problem& problem : problems) {
    if (!message.empty()) message += '\n';
    message += problem.text();
  }
  return {ErrorCode::BadSettings, std::move(message)};
}

}  // namespace overfly::config
