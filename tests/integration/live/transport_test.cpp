#include "capture/pose/transport.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <stdlib.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <unistd.h>

#include <string>
#include <thread>

#include "capture/record/files.h"

namespace overfly::capture {
namespace {

using namespace std::chrono_literals;

std::unique_ptr<Transport> made(const std::string& text) {
  auto transport = makeTransport(text);
  EXPECT_TRUE(transport) << (transport ? "" : transport.error().message);
  return transport ? std::move(*transport) : nullptr;
}

// Reads until something comes.
std::string readSome(Transport& transport) {
  std::vector<std::uint8_t> bytes;
  for (int i = 0; i < 100 && bytes.empty(); ++i)
    if (!transport.read(bytes, 50ms, -1)) break;
  return {bytes.begin(), bytes.end()};
}

std::span<const std::uint8_t> bytesIn(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

TEST(Transport, WordsThatMeanNoLinkAreRefused) {
  for (const char* text : {"", "udp", "udp:", "udp:0", "udp:99999", "udp:not.an.address:14550", "tcp:14550",
                           "tcp::5760", "serial:", "serial:/dev/ttyS0:12345", "usb:1"}) {
    const auto transport = makeTransport(text);
    ASSERT_FALSE(transport) << text;
    EXPECT_EQ(transport.error().code, ErrorCode::BadSettings);
  }
}

TEST(Transport, UdpAnswersTheOneWhoSpokeAndNoStranger) {
  auto link = made("udp:127.0.0.1:24571");
  ASSERT_TRUE(link->open());
  EXPECT_TRUE(link->write(bytesIn("nobody is there")));
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(24571);
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const FileDescriptor peer(::socket(AF_INET, SOCK_DGRAM, 0)), stranger(::socket(AF_INET, SOCK_DGRAM, 0));
  const auto say = [&](const FileDescriptor& from, const std::string& text) {
    ::sendto(from.get(), text.data(), text.size(), 0, reinterpret_cast<sockaddr*>(&to), sizeof to);
  };
  say(peer, "hello");
  EXPECT_EQ(readSome(*link), "hello");
  say(stranger, "me too");
  say(peer, "again");
  EXPECT_EQ(readSome(*link), "again");
  EXPECT_EQ(link->strangers(), 1U);
  ASSERT_TRUE(link->write(bytesIn("answer")));
  char answer[16] = {};
  EXPECT_EQ(::recv(peer.get(), answer, sizeof answer, 0), 6);
  const auto second = made("udp:127.0.0.1:24571")->open();
  ASSERT_FALSE(second);
  EXPECT_NE(second.error().message.find("another program listens"), std::string::npos)
      << second.error().message;
}

TEST(Transport, TcpConnectsAgainAfterTheOtherSideHasGone) {
  auto link = made("tcp:127.0.0.1:24572");
  const auto refused = link->open();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::Unavailable);
  EXPECT_NE(refused.error().message.find("cannot connect"), std::string::npos);
  const FileDescriptor server(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  const int on = 1;
  ::setsockopt(server.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  sockaddr_in at{};
  at.sin_family = AF_INET;
  at.sin_port = htons(24572);
  at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  ASSERT_EQ(::bind(server.get(), reinterpret_cast<sockaddr*>(&at), sizeof at), 0);
  ASSERT_EQ(::listen(server.get(), 4), 0);
  for (int round = 0; round < 3; ++round) {
    ASSERT_TRUE(link->open());
    FileDescriptor client(::accept(server.get(), nullptr, nullptr));
    ASSERT_EQ(::write(client.get(), "data", 4), 4);
    EXPECT_EQ(readSome(*link), "data");
    client = FileDescriptor();
    std::vector<std::uint8_t> bytes;
    Result<void> read;
    for (int i = 0; i < 100 && read; ++i) read = link->read(bytes, 20ms, -1);
    ASSERT_FALSE(read);
    EXPECT_EQ(read.error().code, ErrorCode::Unavailable);
  }
}

TEST(Transport, SerialLinesAreRawAndKeptToOneProgram) {
  const FileDescriptor master(::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC));
  ASSERT_TRUE(master);
  ASSERT_EQ(::grantpt(master.get()) | ::unlockpt(master.get()), 0);
  const std::string device = ::ptsname(master.get());
  auto link = made("serial:" + device + ":921600");
  ASSERT_TRUE(link->open());
  const std::string all("\x00\x03\r\n\xfd\x11\x13\xff", 8);  // what a cooked line would change
  ASSERT_EQ(::write(master.get(), all.data(), all.size()), 8);
  std::string got;
  while (got.size() < all.size()) {
    const std::string some = readSome(*link);
    if (some.empty()) break;
    got += some;
  }
  EXPECT_EQ(got, all);
  ASSERT_TRUE(link->write(bytesIn(all)));
  char back[16] = {};
  EXPECT_EQ(::read(master.get(), back, sizeof back), 8);
  EXPECT_EQ(std::string(back, 8), all);

  const auto second = made("serial:" + device)->open();
  ASSERT_FALSE(second);
  EXPECT_NE(second.error().message.find("another program has"), std::string::npos) << second.error().message;
  const auto absent = made("serial:/dev/ttyNothing:57600")->open();
  ASSERT_FALSE(absent);
  EXPECT_EQ(absent.error().code, ErrorCode::Unavailable);
  const auto file = made("serial:/etc/passwd:57600")->open();
  EXPECT_FALSE(file);
}

}  // namespace
}  // namespace overfly::capture
