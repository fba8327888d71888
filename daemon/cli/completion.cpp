#include <fmt/format.h>

#include <algorithm>
#include <functional>

#include "config/description.h"
#include "daemon/cli/manual.h"

// Both scripts do the same: they follow the words to the command that is meant, and offer its commands,
// options, the values that an option allows, or files.
namespace overfly::cli {
namespace {

// "flight info" of "overfly flight info".
std::string place(const CommandText& command) {
  std::string out;
  for (std::size_t i = 1; i < command.path.size(); ++i) out += (i > 1 ? " " : "") + command.path[i];
  return out;
}

void each(const CommandText& command, const std::function<void(const CommandText&)>& work) {
  work(command);
  for (const auto& one : command.commands) each(one, work);
}

std::string joined(const std::vector<std::string>& words) {
  std::string out;
  for (const auto& word : words) out += (out.empty() ? "" : " ") + word;
  return out;
}

std::vector<std::string> optionNames(const CommandText& command) {
  std::vector<std::string> out;
  for (const auto& option : command.options) out.insert(out.end(), option.names.begin(), option.names.end());
  return out;
}

std::vector<std::string> commandNames(const CommandText& command) {
  std::vector<std::string> out;
  for (const auto& one : command.commands) out.push_back(one.path.back());
  return out;
}

std::string settingKeys() {
  std::string out;
  for (const auto& section : config::description())
    for (const auto& key : section.keys) out += (out.empty() ? "" : " ") + key.path() + "=";
  return out;
}

// The case branches that both shells read alike: from place and word to the next place, and from place and
// option to its values.
std::string walkCases(const CommandText& root) {
  std::string out;
  each(root, [&](const CommandText& command) {
    for (const auto& one : command.commands)
      out += fmt::format("      \"{}:{}\") at=\"{}\" ;;\n", place(command), one.path.back(), place(one));
  });
  return out;
}

std::string valueCases(const CommandText& root) {
  std::string out;
  each(root, [&](const CommandText& command) {
    for (const auto& option : command.options)
      for (const auto& name : option.names)
        if (!option.choices.empty())
          out +=
              fmt::format("    \"{}:{}\") values=\"{}\" ;;\n", place(command), name, joined(option.choices));
  });
  return out;
}

std::string wordCases(const CommandText& root) {
  std::string out;
  each(root, [&](const CommandText& command) {
    auto options = optionNames(command);
    if (command.path.size() > 1)
      for (auto& name : optionNames(root))
        if (std::find(options.begin(), options.end(), name) == options.end()) options.push_back(name);
    out += fmt::format("    \"{}\") commands=\"{}\" options=\"{}\" ;;\n", place(command),
                       joined(commandNames(command)), joined(options));
  });
  return out;
}

std::string bashFunction(const CommandText& root) {
  return fmt::format(
      R"(_{name}() {{
  local cur=${{COMP_WORDS[COMP_CWORD]}} prev=${{COMP_WORDS[COMP_CWORD-1]}} at= word commands= options= values=
  COMPREPLY=()
  for word in "${{COMP_WORDS[@]:1:COMP_CWORD-1}}"; do
    case "$at:$word" in
{walk}      *) ;;
    esac
  done
  case "$at:$prev" in
{values}    *) ;;
  esac
  if [ "$prev" = --set ]; then
    compopt -o nospace
    mapfile -t COMPREPLY < <(compgen -W "{settings}" -- "$cur")
    return
  fi
  if [ -n "$values" ]; then
    mapfile -t COMPREPLY < <(compgen -W "$values" -- "$cur")
    return
  fi
  case "$at" in
{words}    *) ;;
  esac
  case "$cur" in
    -*) mapfile -t COMPREPLY < <(compgen -W "$options" -- "$cur") ;;
    *) if [ -n "$commands" ]; then
         mapfile -t COMPREPLY < <(compgen -W "$commands" -- "$cur")
       else
         compopt -o filenames
         mapfile -t COMPREPLY < <(compgen -f -- "$cur")
       fi ;;
  esac
}}
complete -F _{name} {name}
)",
      fmt::arg("name", root.path[0]), fmt::arg("walk", walkCases(root)), fmt::arg("values", valueCases(root)),
      fmt::arg("words", wordCases(root)), fmt::arg("settings", settingKeys()));
}

std::string zshFunction(const CommandText& root) {
  return fmt::format(
      R"(_{name}() {{
  local at= word commands= options= values= prev=${{words[CURRENT-1]}}
  for word in "${{(@)words[2,CURRENT-1]}}"; do
    case "$at:$word" in
{walk}      *) ;;
    esac
  done
  case "$at:$prev" in
{values}    *) ;;
  esac
  if [[ $prev == --set ]]; then
    compadd -S '' -- ${{=:-{settings}}}
    return
  fi
  if [[ -n $values ]]; then
    compadd -- ${{=values}}
    return
  fi
  case "$at" in
{words}    *) ;;
  esac
  if [[ $PREFIX == -* ]]; then
    compadd -- ${{=options}}
  elif [[ -n $commands ]]; then
    compadd -- ${{=commands}}
  else
    _files
  fi
}}
)",
      fmt::arg("name", root.path[0]), fmt::arg("walk", walkCases(root)), fmt::arg("values", valueCases(root)),
      fmt::arg("words", wordCases(root)), fmt::arg("settings", settingKeys()));
}

}  // namespace

std::string bashCompletion(const CommandText& overfly, const CommandText& overflyd) {
  return "# bash completion for overfly and overflyd: `overfly manual bash`\n" + bashFunction(overfly) +
         bashFunction(overflyd);
}

std::string zshCompletion(const CommandText& overfly, const CommandText& overflyd) {
  return "#compdef overfly overflyd\n# zsh completion: `overfly manual zsh`\n" + zshFunction(overfly) +
         zshFunction(overflyd) + "\"_$service\"\n";
}

}  // namespace overfly::cli
