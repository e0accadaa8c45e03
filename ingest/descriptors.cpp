// SPDX-License-Identifier: Apache-2.0
#include "ingest/descriptors.h"

#include <sys/socket.h>

#include <cerrno>
#include <cstring>

namespace gobo::ingest {
namespace {

struct Message {
  char byte = 0;
  iovec io{&byte, 1};
  alignas(cmsghdr) char space[CMSG_SPACE(sizeof(ReaderDescriptors))] = {};
  msghdr head{};
  Message() {
    head.msg_iov = &io;
    head.msg_iovlen = 1;
    head.msg_control = space;
    head.msg_controllen = sizeof space;
  }
  Message(const Message&) = delete;  // it points into itself
  Message& operator=(const Message&) = delete;
};

}  // namespace

bool sendDescriptors(int socket, const ReaderDescriptors& descriptors) {
  Message message;
  cmsghdr* const head = CMSG_FIRSTHDR(&message.head);
  head->cmsg_level = SOL_SOCKET;
  head->cmsg_type = SCM_RIGHTS;
  head->cmsg_len = CMSG_LEN(sizeof descriptors);
  std::memcpy(CMSG_DATA(head), descriptors.data(), sizeof descriptors);
  for (;;) {
    if (::sendmsg(socket, &message.head, MSG_NOSIGNAL | MSG_DONTWAIT) == 1) return true;
    if (errno != EINTR) return false;
  }
}

bool receiveDescriptors(int socket, ReaderDescriptors& descriptors) {
  descriptors.fill(-1);
  Message message;
  ssize_t n = 0;
  do n = ::recvmsg(socket, &message.head, MSG_CMSG_CLOEXEC);
  while (n < 0 && errno == EINTR);
  if (n <= 0) return false;
  const cmsghdr* const head = CMSG_FIRSTHDR(&message.head);
  if (head && head->cmsg_type == SCM_RIGHTS && head->cmsg_len == CMSG_LEN(sizeof descriptors))
    std::memcpy(descriptors.data(), CMSG_DATA(head), sizeof descriptors);
  return true;
}

}  // namespace gobo::ingest
