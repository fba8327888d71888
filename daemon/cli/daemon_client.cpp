#include "daemon/cli/daemon_client.h"

#include <curl/curl.h>
#include <fmt/format.h>

#include <cctype>
#include <fstream>
#include <memory>

namespace overfly::cli {
namespace {

std::size_t append(const char* bytes, std::size_t size, std::size_t count, void* into) {
  static_cast<std::string*>(into)->append(bytes, size * count);
  return size * count;
}

}  // namespace

Result<DaemonAddress> daemonOf(const Context& context, const std::string& url) {
  DaemonAddress daemon{url, {}, {}};
  const auto loaded = loadSettings(context);
  if (!loaded) return tl::unexpected(loaded.error());
  const config::Link& link = loaded->settings.link;
  if (daemon.url.empty()) {
    const bool any = link.listen == "0.0.0.0" || link.listen == "::";
    const std::string host = any                                          ? "127.0.0.1"
                             : link.listen.find(':') != std::string::npos ? "[" + link.listen + "]"
                                                                          : link.listen;
    daemon.url = fmt::format("{}://{}:{}", link.tls_certificate.empty() ? "http" : "https", host, link.port);
    daemon.ca_file = link.tls_certificate.string();
    std::ifstream file(link.token_file);
    std::getline(file, daemon.token);
  }
  while (daemon.url.ends_with('/')) daemon.url.pop_back();
  return daemon;
}

Result<std::string> askDaemon(const DaemonAddress& daemon, const std::string& method, const std::string& path,
                              const std::string& body) {
  const std::unique_ptr<CURL, decltype(&curl_easy_cleanup)> easy(curl_easy_init(), &curl_easy_cleanup);
  if (!easy) return fail(ErrorCode::Internal, "libcurl does not start");
  CURL* curl = easy.get();
  long status = 0;
  std::string answer;
  const std::string url = daemon.url + path;
  const std::string authorization = "Authorization: Bearer " + daemon.token;
  curl_slist* headers = curl_slist_append(nullptr, "Content-Type: application/json");
  if (!daemon.token.empty()) headers = curl_slist_append(headers, authorization.c_str());
  const std::unique_ptr<curl_slist, decltype(&curl_slist_free_all)> owned(headers, &curl_slist_free_all);
  curl_easy_setopt(curl, CURLOPT_URL, url.c_str());
  curl_easy_setopt(curl, CURLOPT_NOSIGNAL, 1L);
  curl_easy_setopt(curl, CURLOPT_CUSTOMREQUEST, method.c_str());
  curl_easy_setopt(curl, CURLOPT_HTTPHEADER, headers);
  if (!body.empty()) {
    curl_easy_setopt(curl, CURLOPT_POSTFIELDS, body.c_str());
    curl_easy_setopt(curl, CURLOPT_POSTFIELDSIZE, static_cast<long>(body.size()));
  }
  if (!daemon.ca_file.empty()) curl_easy_setopt(curl, CURLOPT_CAINFO, daemon.ca_file.c_str());
  curl_easy_setopt(curl, CURLOPT_TIMEOUT, 30L);
  curl_easy_setopt(curl, CURLOPT_WRITEFUNCTION, &append);
  curl_easy_setopt(curl, CURLOPT_WRITEDATA, static_cast<void*>(&answer));
  if (const CURLcode code = curl_easy_perform(curl); code != CURLE_OK)
    return fail(
        ErrorCode::Unavailable,
        fmt::format("no daemon answers there ({}): is overflyd running, and link.enabled? --url names "
                    "another one",
                    curl_easy_strerror(code)));
  curl_easy_getinfo(curl, CURLINFO_RESPONSE_CODE, &status);
  while (!answer.empty() && std::isspace(static_cast<unsigned char>(answer.back())) != 0) answer.pop_back();
  if (status == 401)
    return fail(ErrorCode::BadSettings,
                "the daemon asks for its token: run this as a user who can read link.token_file, or put "
                "/t/TOKEN behind the address of --url");
  if (status >= 400)
    return fail(ErrorCode::BadInput, answer.empty() ? fmt::format("the daemon answers {}", status) : answer);
  return answer;
}

}  // namespace overfly::cli
