#pragma once
#include <curl/curl.h>

#include <algorithm>
#include <cctype>
#include <map>
#include <string>
#include <vector>

// An HTTP client that is not ours: libcurl.
namespace overfly::test {

struct Answer {
  long status = 0;  // 0: no answer
  std::map<std::string, std::string> headers;
  std::string body;
};

inline Answer fetch(const std::string& url, const std::vector<std::string>& headers = {},
                    const std::string& method = "GET", const std::string& body = {}, long timeout_ms = 20000,
                    std::size_t stop_after = SIZE_MAX) {
  struct Sink {
    Answer answer;
    std::size_t stop_after;
  } sink{{}, stop_after};
  CURL* curl = curl_easy_init();
  curl_slist* list = nullptr;
  for (const auto& h : headers) list = curl_slist_append(list, h.c_str());
  curl_easy_setopt(curl, CURLOPT_URL, url.c_str());
  curl_easy_setopt(curl, CURLOPT_HTTPHEADER, list);
  curl_easy_setopt(curl, CURLOPT_TIMEOUT_MS, timeout_ms);
  curl_easy_setopt(curl, CURLOPT_NOPROXY, "*");
  curl_easy_setopt(curl, CURLOPT_NOSIGNAL, 1L);
  if (method != "GET") {
    curl_easy_setopt(curl, CURLOPT_CUSTOMREQUEST, method.c_str());
    if (!body.empty()) {
      curl_easy_setopt(curl, CURLOPT_POSTFIELDS, body.c_str());
      curl_easy_setopt(curl, CURLOPT_POSTFIELDSIZE, static_cast<long>(body.size()));
    }
  }
  const curl_write_callback write = [](char* data, std::size_t, std::size_t size, void* to) -> std::size_t {
    auto& s = *static_cast<Sink*>(to);
    s.answer.body.append(data, size);
    return s.answer.body.size() >= s.stop_after ? 0 : size;
  };
  const curl_write_callback header = [](char* data, std::size_t, std::size_t size, void* to) -> std::size_t {
    const std::string line(data, size);
    if (const auto colon = line.find(':'); colon != std::string::npos) {
      std::string name = line.substr(0, colon), value = line.substr(colon + 1);
      std::ranges::transform(name, name.begin(),
                             [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
      while (!value.empty() && std::isspace(static_cast<unsigned char>(value.front()))) value.erase(0, 1);
      while (!value.empty() && std::isspace(static_cast<unsigned char>(value.back()))) value.pop_back();
      static_cast<Sink*>(to)->answer.headers[name] = value;
    }
    return size;
  };
  curl_easy_setopt(curl, CURLOPT_WRITEFUNCTION, write);
  curl_easy_setopt(curl, CURLOPT_WRITEDATA, &sink);
  curl_easy_setopt(curl, CURLOPT_HEADERFUNCTION, header);
  curl_easy_setopt(curl, CURLOPT_HEADERDATA, &sink);
  curl_easy_perform(curl);
  curl_easy_getinfo(curl, CURLINFO_RESPONSE_CODE, &sink.answer.status);
  curl_slist_free_all(list);
  curl_easy_cleanup(curl);
  return sink.answer;
}

}  // namespace overfly::test
