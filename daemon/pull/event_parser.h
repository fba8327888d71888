#pragma once
#include <functional>
#include <string>
#include <string_view>

namespace overfly::pull {

// Server-Sent Events out of a byte stream (HTML standard, 9.2.6), for the fields that the link sends. One
// thread.
class EventParser {
 public:
  using Handler =
      std::function<void(const std::string& event, const std::string& id, const std::string& data)>;
  explicit EventParser(Handler handler) : handler_(std::move(handler)) {}

  void feed(std::string_view bytes) {
    line_.append(bytes);
    std::size_t begin = 0;
    for (std::size_t end = line_.find('\n'); end != std::string::npos; end = line_.find('\n', begin)) {
      take(std::string_view(line_).substr(begin, end - begin));
      begin = end + 1;
    }
    line_.erase(0, begin);
  }

 private:
  void take(std::string_view line) {
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (line.empty()) {
      if (!data_.empty()) handler_(event_, id_, data_);
      event_.clear();
      data_.clear();
      return;
    }
    const auto colon = line.find(':');
    const auto name = line.substr(0, colon);
    auto value = colon == std::string_view::npos ? std::string_view() : line.substr(colon + 1);
    if (value.starts_with(' ')) value.remove_prefix(1);
    if (name == "event") event_ = value;
    if (name == "id") id_ = value;
    if (name == "data") {
      if (!data_.empty()) data_ += '\n';
      data_ += value;
    }
  }

  Handler handler_;
  std::string line_, event_, id_, data_;
};

}  // namespace overfly::pull
