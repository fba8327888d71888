#pragma once
#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

extern char** environ;

// A node program with pipes to its standard input and from its standard output. Ends when its input is
// closed, and is killed when it does not.
class NodeProgram {
 public:
  explicit NodeProgram(const std::vector<std::string>& arguments) {
    ::signal(SIGPIPE, SIG_IGN);  // a program that ended early is a failed test, not a killed one
    int in[2], out[2];
    if (::pipe2(in, O_CLOEXEC) != 0 || ::pipe2(out, O_CLOEXEC) != 0) std::abort();
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, in[0], 0);
    posix_spawn_file_actions_adddup2(&actions, out[1], 1);
    std::vector<std::string> words{OVERFLY_NODE};
    words.insert(words.end(), arguments.begin(), arguments.end());
    std::vector<char*> pointers;
    for (std::string& word : words) pointers.push_back(word.data());
    pointers.push_back(nullptr);
    ::setenv("OVERFLY_PEER_MODULES", OVERFLY_PEER_MODULES, 1);
    if (::posix_spawn(&pid_, OVERFLY_NODE, &actions, nullptr, pointers.data(), environ) != 0) pid_ = -1;
    posix_spawn_file_actions_destroy(&actions);
    ::close(in[0]);
    ::close(out[1]);
    input_ = ::fdopen(in[1], "w");
    output_ = ::fdopen(out[0], "r");
  }
  ~NodeProgram() {
    closeInput();
    for (int i = 0; pid_ > 0 && i < 200; ++i) {
      if (::waitpid(pid_, nullptr, WNOHANG) == pid_) pid_ = -1;
      ::usleep(10'000);
    }
    if (pid_ > 0) {
      ::kill(pid_, SIGKILL);
      ::waitpid(pid_, nullptr, 0);
    }
    std::fclose(output_);
  }
  NodeProgram(const NodeProgram&) = delete;
  NodeProgram& operator=(const NodeProgram&) = delete;

  void write(const std::string& line) { std::fputs((line + "\n").c_str(), input_); }
  void closeInput() {
    if (input_ != nullptr) std::fclose(input_);
    input_ = nullptr;
  }
  // The next line without its end; empty at the end of the output.
  std::string read() {
    char* line = nullptr;
    std::size_t size = 0;
    const ssize_t length = ::getline(&line, &size, output_);
    std::string text(line != nullptr && length > 0 ? line : "");
    std::free(line);
    while (!text.empty() && text.back() == '\n') text.pop_back();
    return text;
  }

 private:
  pid_t pid_ = -1;
  std::FILE* input_ = nullptr;
  std::FILE* output_ = nullptr;
};
