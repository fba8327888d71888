#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

namespace {

struct Told {
  int status = -1;
  std::string text;
  nlohmann::json json;
};

Told doctor(const std::string& arguments) {
  Told out;
  const auto command =
      std::string(OVERFLY_BINARY_DIR) + "/bin/overfly doctor --set map.folder=/tmp " + arguments;
  std::FILE* pipe = popen(command.c_str(), "r");
  std::array<char, 4096> block{};
  while (const auto size = std::fread(block.data(), 1, block.size(), pipe))
    out.text.append(block.data(), size);
  out.status = WEXITSTATUS(pclose(pipe));
  out.json = nlohmann::json::parse(out.text, nullptr, false);
  return out;
}

TEST(Doctor, SaysOneLineOfEachPartAndTheSameToPrograms) {
  const auto people = doctor(""), programs = doctor("--json");
  EXPECT_EQ(std::count(people.text.begin(), people.text.end(), '\n'), 7) << people.text;
  ASSERT_TRUE(programs.json.is_object()) << programs.text;
  for (const auto* name : {"built in", "GPU", "cameras", "GPIO", "disk", "clock", "autopilot"}) {
    EXPECT_NE(people.text.find(name), std::string::npos) << name;
    const std::string state = programs.json[name]["state"];
    EXPECT_TRUE(state == "OK" || state == "warning" || state == "PROBLEM") << state;
    // What is not in order comes with what to do.
    EXPECT_EQ(programs.json[name].contains("advice"), state != "OK") << name;
  }
  EXPECT_GT(programs.json["disk"]["write MB/s"].get<double>(), 0);
}

TEST(Doctor, WhatTheSettingsAskForAndIsNotThereIsAProblem) {
  const auto chip = doctor("--json --set gpio.chip=gpiochip99");
  EXPECT_EQ(chip.status, 1);
  EXPECT_EQ(chip.json["GPIO"]["state"], "PROBLEM");
  const auto disk = doctor("--json --set map.folder=/proc/overfly");
  EXPECT_EQ(disk.status, 1);
  EXPECT_EQ(disk.json["disk"]["state"], "PROBLEM");
  const auto serial = doctor("--json --set pose.mavlink=serial:/dev/ttyNONE:57600");
  EXPECT_EQ(serial.status, 1);
  EXPECT_EQ(serial.json["autopilot"]["state"], "PROBLEM");
}

TEST(Doctor, ListsTheGpusAndTakesTheOneThatIsNamed) {
  const auto any = doctor("--json");
  const auto& devices = any.json["GPU"]["devices"];
  ASSERT_TRUE(devices.is_array() && !devices.empty()) << any.text;
  const std::string first = devices[0];
  EXPECT_EQ(first.rfind("0: ", 0), 0u) << first;
  const auto named = doctor("--json --set gpu.device=0");
  EXPECT_NE(named.json["GPU"]["state"], "PROBLEM") << named.text;
  EXPECT_NE(first.find(named.json["GPU"]["renderer"].get<std::string>()), std::string::npos) << named.text;
  const auto missing = doctor("--json --set gpu.device=/dev/dri/renderD200");
  EXPECT_EQ(missing.status, 1);
  EXPECT_EQ(missing.json["GPU"]["state"], "PROBLEM");
  const std::string finding = missing.json["GPU"]["finding"];
  EXPECT_NE(finding.find("/dev/dri/renderD200"), std::string::npos) << finding;
  EXPECT_NE(finding.find(first), std::string::npos) << finding;
}

TEST(Doctor, AnAutopilotIsHeardOrSilent) {
  const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof to;
  // a free port: one that the system just gave
  ASSERT_EQ(bind(fd, reinterpret_cast<sockaddr*>(&to), sizeof to), 0);
  getsockname(fd, reinterpret_cast<sockaddr*>(&to), &size);
  close(fd);
  const auto link = " --set pose.mavlink=udp:127.0.0.1:" + std::to_string(ntohs(to.sin_port));
  EXPECT_EQ(doctor("--json" + link).json["autopilot"]["state"], "warning");

  std::atomic<bool> done{false};
  std::thread autopilot([&] {
    const int sender = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    const unsigned char heartbeat[21] = {0xfd, 9, 0, 0, 0, 1, 1};
    while (!done) {
      sendto(sender, heartbeat, sizeof heartbeat, 0, reinterpret_cast<sockaddr*>(&to), sizeof to);
      usleep(50000);
    }
    close(sender);
  });
  const auto heard = doctor("--json" + link);
  done = true;
  autopilot.join();
  EXPECT_EQ(heard.json["autopilot"]["state"], "OK") << heard.text;
}

}  // namespace
