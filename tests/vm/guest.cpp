#include "tests/vm/guest.h"

#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <thread>
#include <vector>

#include "tests/base64.h"
#include "tests/shell.h"

namespace overfly::vm {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using namespace std::chrono_literals;
using test::fromBase64;
using test::Outcome;
using test::shell;
using test::toBase64;

// A boot takes 20 s on two free cores.
constexpr auto kBootLimit = 600s;

struct Image {
  std::string folder, problem;
};

// Once in a process.
const Image& image() {
  static const Image found = [] {
    Image out;
    if (shell("command -v qemu-system-x86_64").status != 0) {
      out.problem = "qemu-system-x86_64 is not here (Debian package qemu-system-x86)";
      return out;
    }
    const char* asked = std::getenv("OVERFLY_VM_BUILD_SECONDS");
    const std::string seconds = asked != nullptr ? asked : "0";
    const std::string program = "'" OVERFLY_SOURCE_DIR "/tests/vm/image'";
    const Outcome made =
        shell((seconds == "0" ? program + " --cached" : "timeout " + seconds + " " + program) +
              " 2>/dev/null </dev/null");
    if (made.status == 0) {
      const std::string line = made.output.substr(0, made.output.find_last_not_of('\n') + 1);
      out.folder = line.substr(line.rfind('\n') + 1);
    } else if (seconds == "0") {
      out.problem = "the guest's image is not cached: ./tests/run vm makes it";
    } else if (made.status == 124) {
      out.problem = "the guest's image is not cached and was not built within " + seconds +
                    " s (OVERFLY_VM_BUILD_SECONDS): run tests/vm/image once";
    } else {
      out.problem = "the guest's image is not cached and cannot be built here: run tests/vm/image to see why";
    }
    return out;
  }();
  return found;
}

int freePort(int type) {
  const int fd = socket(AF_INET, type, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  if (bind(fd, reinterpret_cast<sockaddr*>(&address), size) != 0) throw std::runtime_error("no free port");
  getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size);
  close(fd);
  return ntohs(address.sin_port);
}

}  // namespace

std::string Guest::whyNot() { return image().problem; }

Guest::Guest(fs::path disk, std::uint64_t disk_bytes) {
  if (!image().problem.empty()) throw std::runtime_error(image().problem);
  std::string name = (fs::temp_directory_path() / "overfly_vm_XXXXXX").string();
  if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder");
  folder_ = name;
  start(disk, disk_bytes);
  connectAgent();
  const Ran ready = run("date -s @" + std::to_string(std::time(nullptr)) +
                        " >/dev/null; modprobe -a 9p 9pnet_virtio; "
                        "mount /mnt/host");
  if (ready.status != 0) throw std::runtime_error("the guest is not as it should be: " + ready.output);
}

Guest::~Guest() {
  powerOff();
  std::error_code ignored;
  fs::remove_all(folder_, ignored);
}

void Guest::start(const fs::path& disk, std::uint64_t disk_bytes) {
  const bool keeps = !disk.empty();
  const fs::path second = keeps ? disk : folder_ / "disk.img";
  if (!fs::exists(second)) {
    std::ofstream(second).close();
    fs::resize_file(second, disk_bytes);
    if (shell("PATH=$PATH:/sbin:/usr/sbin mke2fs -q -t ext4 '" + second.string() + "' 2>&1").status != 0)
      throw std::runtime_error("mke2fs failed");
  }
  link_port_ = freePort(SOCK_STREAM);
  mavlink_port_ = freePort(SOCK_DGRAM);
  const std::string files = image().folder;
  // Without AVX: llvmpipe's code for it dies under emulation. The network is not restricted, or answers by UDP
  // would not come out.
  std::vector<std::string> line{
      "qemu-system-x86_64",
      "-accel",
      "kvm",
      "-accel",
      "tcg,thread=multi,tb-size=512",
      "-machine",
      "q35",
      "-cpu",
      "max,avx=off,avx2=off",
      "-m",
      "3072",
      "-smp",
      "2",
      "-nodefaults",
      "-nographic",
      "-kernel",
      files + "/vmlinuz",
      "-initrd",
      files + "/initrd.img",
      "-append",
      std::string("console=ttyS0 quiet systemd.show_status=0 overfly.keep=") + (keeps ? "1" : "0"),
      "-drive",
      "file=" + files + "/root.img,format=raw,if=virtio,readonly=on",
      "-drive",
      "file=" + second.string() + ",format=raw,if=virtio",
      "-fsdev",
      "local,id=share,security_model=none,readonly=on,path=" OVERFLY_BINARY_DIR,
      "-device",
      "virtio-9p-pci,fsdev=share,mount_tag=overfly",
      "-device",
      "virtio-serial-pci",
      "-chardev",
      "socket,id=agent,server=on,wait=off,path=" + (folder_ / "agent").string(),
      "-device",
      "virtserialport,chardev=agent,name=overfly.agent",
      "-netdev",
      "user,id=net,hostfwd=tcp:127.0.0.1:" + std::to_string(link_port_) +
          "-:8420,hostfwd=udp:127.0.0.1:" + std::to_string(mavlink_port_) + "-:14550",
      "-device",
      "virtio-net-pci,netdev=net",
      "-serial",
      "file:" + (folder_ / "console").string()};
  if (access("/dev/kvm", R_OK | W_OK) != 0) line.erase(line.begin() + 1, line.begin() + 3);
  std::vector<char*> arguments;
  for (std::string& word : line) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  const std::string log = (folder_ / "qemu").string();
  qemu_ = fork();
  if (qemu_ == 0) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    const int out = ::open(log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    dup2(out, STDOUT_FILENO);
    dup2(out, STDERR_FILENO);
    execvp(arguments[0], arguments.data());
    _exit(127);
  }
}

void Guest::connectAgent() {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  (folder_ / "agent").string().copy(address.sun_path, sizeof address.sun_path - 1);
  const auto until = Clock::now() + kBootLimit;
  agent_ = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  while (connect(agent_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) {
    if (Clock::now() > until || waitpid(qemu_, nullptr, WNOHANG) == qemu_) {
      qemu_ = -1;
      std::ifstream log(folder_ / "qemu");
      throw std::runtime_error("QEMU does not run: " + std::string(std::istreambuf_iterator<char>(log), {}));
    }
    std::this_thread::sleep_for(50ms);
  }
  if (readLine(until).rfind("ready", 0) != 0)
    throw std::runtime_error("the guest does not come up:\n" + console());
}

std::string Guest::readLine(Clock::time_point until) {
  for (;;) {
    if (const std::size_t end = received_.find('\n'); end != std::string::npos) {
      std::string line = received_.substr(0, end);
      received_.erase(0, end + 1);
      return line;
    }
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - Clock::now());
    pollfd wait{agent_, POLLIN, 0};
    if (left.count() <= 0 || poll(&wait, 1, static_cast<int>(left.count())) <= 0) return {};
    std::array<char, 65536> block{};
    const ssize_t bytes = read(agent_, block.data(), block.size());
    if (bytes <= 0) return {};
    received_.append(block.data(), static_cast<std::size_t>(bytes));
  }
}

Guest::Ran Guest::run(const std::string& script, std::chrono::seconds limit) {
  const std::string number = std::to_string(++number_);
  const std::string request = number + " " + toBase64(script) + "\n";
  for (std::size_t sent = 0; sent < request.size();) {
    const ssize_t bytes = send(agent_, request.data() + sent, request.size() - sent, MSG_NOSIGNAL);
    if (bytes <= 0) return {-1, "the guest is off"};
    sent += static_cast<std::size_t>(bytes);
  }
  const auto until = Clock::now() + limit;
  for (;;) {
    const std::string line = readLine(until);
    if (line.empty()) return {-1, "no answer within " + std::to_string(limit.count()) + " s\n" + console()};
    const std::size_t first = line.find(' '), second = line.find(' ', first + 1);
    // Answers to what was given up before are passed over.
    if (first == std::string::npos || second == std::string::npos || line.substr(0, first) != number)
      continue;
    return {std::stoi(line.substr(first + 1, second - first - 1)), fromBase64(line.substr(second + 1))};
  }
}

Guest::Ran Guest::runUntilGood(const std::string& script, std::chrono::seconds limit) {
  const auto until = Clock::now() + limit;
  for (;;) {
    const auto left = std::chrono::ceil<std::chrono::seconds>(until - Clock::now());
    Ran ran = run(script, std::max(left, 1s));
    if (ran.status == 0 || Clock::now() >= until) return ran;
    std::this_thread::sleep_for(200ms);
  }
}

void Guest::powerOff() {
  if (qemu_ > 0) {
    kill(qemu_, SIGKILL);
    waitpid(qemu_, nullptr, 0);
    qemu_ = -1;
  }
  if (agent_ >= 0) close(agent_);
  agent_ = -1;
}

std::string Guest::console() const {
  std::ifstream in(folder_ / "console");
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  return text.substr(text.size() > 2000 ? text.size() - 2000 : 0);
}

}  // namespace overfly::vm
