#include "render/gl/detail/preprocess.h"

#include <cctype>
#include <regex>
#include <sstream>
#include <vector>

namespace overfly::gl::detail {
namespace {

constexpr int kMaxDepth = 16;  // of names that stand for names

bool isNameStart(char c) { return std::isalpha(static_cast<unsigned char>(c)) != 0 || c == '_'; }
bool isNamePart(char c) { return isNameStart(c) || std::isdigit(static_cast<unsigned char>(c)) != 0; }

// Recursive descent over one expression; `failed_` once anything is not understood.
class Parser {
 public:
  Parser(std::string_view text, const Macros& macros, bool unknown_is_zero, int depth)
      : text_(text), macros_(macros), unknown_is_zero_(unknown_is_zero), depth_(depth) {}

  std::optional<std::int64_t> value() {
    const std::int64_t out = binary(0);
    skipSpace();
    if (failed_ || at_ != text_.size()) return std::nullopt;
    return out;
  }

 private:
  struct Operator {
    std::string_view text;
    int level;
  };
  // Longest first within what shares a beginning.
  static constexpr Operator kOperators[] = {{"||", 1}, {"&&", 2}, {"==", 3}, {"!=", 3}, {"<=", 4},
                                            {">=", 4}, {"<", 4},  {">", 4},  {"+", 5},  {"-", 5},
                                            {"*", 6},  {"/", 6},  {"%", 6}};

  void skipSpace() {
    while (at_ < text_.size() && std::isspace(static_cast<unsigned char>(text_[at_])) != 0) ++at_;
  }
  bool accept(std::string_view token) {
    skipSpace();
    if (text_.substr(at_, token.size()) != token) return false;
    at_ += token.size();
    return true;
  }
  std::string_view name() {
    const std::size_t begin = at_;
    while (at_ < text_.size() && isNamePart(text_[at_])) ++at_;
    return text_.substr(begin, at_ - begin);
  }

  std::int64_t binary(int level) {
    std::int64_t left = unary();
    for (;;) {
      skipSpace();
      const Operator* found = nullptr;
      for (const Operator& one : kOperators) {
        if (one.level > level && text_.substr(at_, one.text.size()) == one.text) {
          found = &one;
          break;
        }
      }
      if (found == nullptr || failed_) return left;
      at_ += found->text.size();
      left = apply(found->text, left, binary(found->level));
    }
  }

  std::int64_t apply(std::string_view op, std::int64_t a, std::int64_t b) {
    if (op == "||") return (a != 0 || b != 0) ? 1 : 0;
    if (op == "&&") return (a != 0 && b != 0) ? 1 : 0;
    if (op == "==") return a == b ? 1 : 0;
    if (op == "!=") return a != b ? 1 : 0;
    if (op == "<=") return a <= b ? 1 : 0;
    if (op == ">=") return a >= b ? 1 : 0;
    if (op == "<") return a < b ? 1 : 0;
    if (op == ">") return a > b ? 1 : 0;
    if (op == "+") return a + b;
    if (op == "-") return a - b;
    if (op == "*") return a * b;
    if (b == 0) {
      failed_ = true;
      return 0;
    }
    return op == "/" ? a / b : a % b;
  }

  std::int64_t unary() {
    if (accept("!")) return unary() == 0 ? 1 : 0;
    if (accept("-")) return -unary();
    if (accept("+")) return unary();
    if (accept("(")) {
      const std::int64_t out = binary(0);
      if (!accept(")")) failed_ = true;
      return out;
    }
    skipSpace();
    if (at_ < text_.size() && std::isdigit(static_cast<unsigned char>(text_[at_])) != 0) return literal();
    if (at_ < text_.size() && isNameStart(text_[at_])) return named();
    failed_ = true;
    return 0;
  }

  std::int64_t literal() {
    const std::string_view digits = name();  // letters too: 0x1F, 64u
    try {
      std::size_t used = 0;
      const std::int64_t out = std::stoll(std::string(digits), &used, 0);
      const std::string_view rest = digits.substr(used);
      if (!rest.empty() && rest != "u" && rest != "U") failed_ = true;
      return out;
    } catch (const std::exception&) {
      failed_ = true;
      return 0;
    }
  }

  std::int64_t named() {
    const std::string_view word = name();
    if (word == "defined") {
      const bool brackets = accept("(");
      skipSpace();
      const std::string_view what = name();
      if (brackets && !accept(")")) failed_ = true;
      return macros_.find(what) != macros_.end() ? 1 : 0;
    }
    if (word == "int" || word == "uint") {  // a conversion: int(...)
      if (!accept("(")) failed_ = true;
      const std::int64_t out = binary(0);
      if (!accept(")")) failed_ = true;
      return out;
    }
    const auto known = macros_.find(word);
    if (known != macros_.end() && depth_ < kMaxDepth) {
      const auto out = Parser(known->second, macros_, unknown_is_zero_, depth_ + 1).value();
      if (out) return *out;
    }
    if (!unknown_is_zero_ || known != macros_.end()) failed_ = true;
    return 0;
  }

  std::string_view text_;
  const Macros& macros_;
  bool unknown_is_zero_;
  int depth_;
  std::size_t at_ = 0;
  bool failed_ = false;
};

std::string withoutComments(std::string_view text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text.substr(i, 2) == "//") {
      while (i < text.size() && text[i] != '\n') ++i;
      out += '\n';
    } else if (text.substr(i, 2) == "/*") {
      const std::size_t end = text.find("*/", i + 2);
      i = end == std::string_view::npos ? text.size() : end + 1;
      out += ' ';
    } else if (text.substr(i, 2) == "\\\n") {
      ++i;
    } else {
      out += text[i];
    }
  }
  return out;
}

struct Branch {
  bool outer;  // what surrounds it is kept
  bool taken;  // one of its parts was kept already
  bool active;
};

}  // namespace

std::optional<std::int64_t> evaluate(std::string_view expression, const Macros& macros,
                                     bool unknown_is_zero) {
  return Parser(expression, macros, unknown_is_zero, 0).value();
}

std::string preprocess(std::string_view text, Macros& macros) {
  static const std::regex directive(R"(^\s*#\s*(\w+)\s*(.*?)\s*$)");
  static const std::regex definition(R"(^(\w+)(\(?)(.*)$)");
  static const std::regex constant(R"(const\s+(?:highp\s+|mediump\s+)?u?int\s+(\w+)\s*=\s*([^;]+);)");
  std::istringstream lines(withoutComments(text));
  std::string out;
  std::vector<Branch> branches;
  for (std::string line; std::getline(lines, line);) {
    const bool active = branches.empty() || branches.back().active;
    std::smatch match;
    if (!std::regex_match(line, match, directive)) {
      if (!active) continue;
      if (std::smatch found; std::regex_search(line, found, constant))
        macros[found[1].str()] = "(" + found[2].str() + ")";
      out += line + "\n";
      continue;
    }
    const std::string word = match[1].str(), rest = match[2].str();
    const auto holds = [&] { return evaluate(rest, macros, true).value_or(0) != 0; };
    if (word == "if" || word == "ifdef" || word == "ifndef") {
      const bool condition = word == "if" ? active && holds() : (macros.count(rest) > 0) == (word == "ifdef");
      branches.push_back({active, condition, active && condition});
    } else if (word == "elif" && !branches.empty()) {
      Branch& branch = branches.back();
      branch.active = branch.outer && !branch.taken && holds();
      branch.taken = branch.taken || branch.active;
    } else if (word == "else" && !branches.empty()) {
      Branch& branch = branches.back();
      branch.active = branch.outer && !branch.taken;
      branch.taken = true;
    } else if (word == "endif" && !branches.empty()) {
      branches.pop_back();
    } else if (active && word == "define") {
      std::smatch parts;
      if (std::regex_match(rest, parts, definition) && parts[2].length() == 0)
        macros[parts[1].str()] = parts[3].str();
    } else if (active && word == "undef") {
      macros.erase(rest);
    } else if (active && word == "extension") {
      out += "#extension " + rest + "\n";
    }
  }
  return out;
}

}  // namespace overfly::gl::detail
