#include "daemon/cli/manual.h"

#include <fmt/format.h>

#include "config/description.h"

namespace overfly::cli {
namespace {

// A character of UTF-8 at `at`, which moves behind it; roff itself reads ASCII.
std::string unicode(std::string_view text, std::size_t& at) {
  const auto lead = static_cast<unsigned char>(text[at++]);
  unsigned point = lead >= 0xf0 ? lead & 0x07u : lead >= 0xe0 ? lead & 0x0fu : lead & 0x1fu;
  while (at < text.size() && (static_cast<unsigned char>(text[at]) & 0xc0u) == 0x80u)
    point = point << 6 | (static_cast<unsigned char>(text[at++]) & 0x3fu);
  return fmt::format("\\[u{:04X}]", point);
}

// Text that roff takes as it stands.
std::string plain(std::string_view text) {
  std::string out;
  for (std::size_t at = 0; at < text.size();) {
    const char c = text[at];
    const bool line_begins = out.empty() || out.back() == '\n';
    if (static_cast<unsigned char>(c) >= 0x80) {
      out += unicode(text, at);
      continue;
    }
    ++at;
    if (c == '\\')
      out += "\\e";
    else if (c == '-')
      out += "\\-";
    else if ((c == '.' || c == '\'') && line_begins)
      out += std::string("\\&") + c;
    else
      out += c;
  }
  return out;
}

std::string bold(std::string_view text) { return "\\fB" + plain(text) + "\\fR"; }
std::string italic(std::string_view text) { return "\\fI" + plain(text) + "\\fR"; }

std::string head(const char* name, const char* section, const char* summary) {
  return fmt::format(".TH {} {} \"\" \"overfly {}\"\n.nh\n.SH NAME\n{} \\- {}\n", name, section,
                     OVERFLY_VERSION, plain(name), plain(summary));
}

std::string item(const OptionText& option) {
  std::string out = ".TP\n";
  if (!option.positional.empty()) {
    out += italic(option.positional);
  } else {
    std::string names;
    for (const auto& name : option.names) names += (names.empty() ? "" : ", ") + bold(name);
    out += names;
    if (!option.value.empty()) out += " " + italic(option.value);
  }
  out += "\n" + plain(option.help.empty() ? "(see above)" : option.help);
  if (!option.choices.empty()) {
    out += "; one of";
    for (std::size_t i = 0; i < option.choices.size(); ++i)
      out += (i == 0 ? " " : ", ") + plain(option.choices[i]);
  }
  if (!option.default_text.empty()) out += "; default " + plain(option.default_text);
  return out + "\n";
}

std::string options(const CommandText& command, bool with_help) {
  std::string out;
  for (const auto& option : command.options) {
    const bool is_help = !option.names.empty() && option.names.back() == "--help";
    if (with_help || !is_help) out += item(option);
  }
  return out;
}

std::string section(const CommandText& command) {
  std::string out =
      ".SS " + bold(command.title()) + plain(command.synopsis()) + "\n" + plain(command.summary) + ".\n";
  out += options(command, false);
  if (!command.footer.empty()) out += ".PP\n" + plain(command.footer) + "\n";
  for (const auto& one : command.commands) out += section(one);
  return out;
}

constexpr const char* kFiles =
    ".SH FILES\n"
    ".TP\n\\fI/etc/overfly/overfly.toml\\fR\nThe settings; see\n.BR overfly.toml (5).\n"
    ".TP\n\\fI/etc/overfly/conf.d/*.toml\\fR\nFurther settings, in the order of their names; later ones "
    "win.\n";

}  // namespace

std::string commandPage(const CommandText& overfly) {
  auto out = head("overfly", "1", "works with flights and maps, on the drone and on the ground");
  out += ".SH SYNOPSIS\n" + bold("overfly") + plain(" [OPTIONS] COMMAND ...") + "\n.SH DESCRIPTION\n" +
         plain(overfly.summary) + "\n" +
         ".BR overflyd (8)\nis the service that maps live; this program is everything beside it.\n"
         ".SH OPTIONS\nThese may stand before and behind the command.\n";
  out += options(overfly, true) + ".SH COMMANDS\n";
  for (const auto& command : overfly.commands) out += section(command);
  out +=
      ".SH EXIT STATUS\n.TP\n0\nThe work is done.\n.TP\n1\nIt could not be done; the message says what to "
      "do.\n.TP\n2\n"
      "Arguments or settings have to be changed.\n";
  return out + kFiles + ".SH SEE ALSO\n.BR overflyd (8),\n.BR overfly.toml (5)\n";
}

std::string daemonPage(const CommandText& overflyd) {
  auto out = head("overflyd", "8", "maps while the drone flies");
  out += ".SH SYNOPSIS\n" + bold("overflyd") + plain(overflyd.synopsis()) + "\n.SH DESCRIPTION\n" +
         plain(overflyd.summary) +
         "\nIt takes frames from the source that the settings name, maps them as they come, and serves the "
         "map over "
         "HTTP; the operator page's address is printed at the start. Sources may be absent, come and go. A "
         "map goes on "
         "where it was after any end of the process.\n"
         ".SH OPTIONS\n";
  out += options(overflyd, true);
  out +=
      ".SH SIGNALS\n.TP\nSIGTERM, SIGINT\nEnds it; what was mapped is kept.\n.TP\nSIGHUP\nReads the settings "
      "again; "
      "those that can change while it runs do (see\n.BR overfly.toml (5)).\n"
      ".SH EXIT STATUS\n.TP\n0\nEnded as asked.\n.TP\n1\nCould not go on; systemd starts it "
      "again.\n.TP\n2\nSettings "
      "have to be changed; systemd does not start it again.\n";
  return out + kFiles + ".SH SEE ALSO\n.BR overfly (1),\n.BR overfly.toml (5)\n";
}

std::string settingsPage() {
  auto out = head("overfly.toml", "5", "settings of overflyd and overfly");
  out += ".SH DESCRIPTION\nTOML files: " + italic("/etc/overfly/overfly.toml") + ", then " +
         italic("/etc/overfly/conf.d/*.toml") +
         "\nin the order of their names, then environment variables OVERFLY_SECTION_KEY, then " +
         bold("--set") +
         "\non the command line; later ones win. A key that is not known, or a value that is not allowed, is "
         "an error "
         "with file and line. " +
         bold("overfly config check") + "\ntells all of them, " + bold("overfly config print") +
         "\nthe settings in force.\n.PP\nKeys marked with * may change while the service runs (SIGHUP).\n";
  const config::Settings defaults;
  for (const auto& one : config::description()) {
    out += fmt::format(".SH [{}]\n{}.\n", plain(one.name), plain(one.help));
    for (const auto& key : one.keys)
      out += fmt::format(".TP\n{}{}\n{}. {}. Default: {}\n", bold(key.name), key.live ? " *" : "",
                         plain(key.help), plain(config::allowed(key)),
                         plain(config::tomlText(key.get(defaults))));
  }
  return out + ".SH SEE ALSO\n.BR overfly (1),\n.BR overflyd (8)\n";
}

}  // namespace overfly::cli
