#pragma once
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace overfly::test {

// A running program; killed with the object. Its output goes to files of the test's folder, or its first line
// is waited for.
class Program {
 public:
  explicit Program(std::vector<std::string> arguments, const std::string& errors = "/dev/null") {
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) throw std::runtime_error("pipe");
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, ends[1], 1);
    posix_spawn_file_actions_addopen(&actions, 2, errors.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600);
    std::vector<char*> pointers;
    for (auto& one : arguments) pointers.push_back(one.data());
    pointers.push_back(nullptr);
    const int code = posix_spawn(&pid_, pointers[0], &actions, nullptr, pointers.data(), environ);
    posix_spawn_file_actions_destroy(&actions);
    close(ends[1]);
    output_ = ends[0];
    if (code != 0) throw std::runtime_error("cannot run " + arguments[0]);
  }
  ~Program() {
    end(SIGKILL);
    close(output_);
  }
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  // The next line of its output; empty when it ended or the time passed.
  std::string line(std::chrono::milliseconds at_most) {
    const auto until = std::chrono::steady_clock::now() + at_most;
    for (;;) {
      if (const auto end = text_.find('\n'); end != std::string::npos) {
        auto out = text_.substr(0, end);
        text_.erase(0, end + 1);
        return out;
      }
      const auto left =
          std::chrono::duration_cast<std::chrono::milliseconds>(until - std::chrono::steady_clock::now());
      pollfd wait{output_, POLLIN, 0};
      if (left.count() <= 0 || poll(&wait, 1, static_cast<int>(left.count())) <= 0) return {};
      char block[4096];
      const auto size = read(output_, block, sizeof block);
      if (size <= 0) return std::exchange(text_, {});  // a last line without its end
      text_.append(block, static_cast<std::size_t>(size));
    }
  }
  [[nodiscard]] pid_t pid() const { return pid_; }
  void signal(int number) const {
    if (pid_ > 0) kill(pid_, number);
  }
  // The exit status, once it has ended; 128 + signal when it was killed.
  std::optional<int> wait(std::chrono::milliseconds at_most) {
    const auto until = std::chrono::steady_clock::now() + at_most;
    while (pid_ > 0) {
      int status = 0;
      if (waitpid(pid_, &status, WNOHANG) == pid_) {
        pid_ = -1;
        ended_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
      } else if (std::chrono::steady_clock::now() >= until) {
        return std::nullopt;
      } else {
        usleep(10000);
      }
    }
    return ended_;
  }
  void end(int number) {
    signal(number);
    if (pid_ > 0 && !wait(std::chrono::seconds(20))) {
      signal(SIGKILL);
      wait(std::chrono::seconds(20));
    }
  }

 private:
  pid_t pid_ = -1;
  int output_ = -1, ended_ = -1;
  std::string text_;
};

}  // namespace overfly::test
