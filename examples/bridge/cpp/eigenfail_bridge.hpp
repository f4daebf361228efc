// A bridge: a process that holds simulator and planner, for eigenfail to search for failures in.
// docs/bridge.md has the protocol. Needs C++17 and libzmq; the headers beside this are part of it.
#pragma once

#include <zmq.h>

#include <csignal>
#include <iostream>

#include "answers.hpp"

namespace eigenfail {

// A REP socket that is closed when it goes out of scope.
class Socket {
public:
    explicit Socket(const std::string& address) {
        const std::int64_t most_bytes = 16 * 1024 * 1024;
        const int linger_ms = 200, patience_ms = 200;
        zmq_setsockopt(socket_.get(), ZMQ_MAXMSGSIZE, &most_bytes, sizeof most_bytes);
        zmq_setsockopt(socket_.get(), ZMQ_LINGER, &linger_ms, sizeof linger_ms);
        zmq_setsockopt(socket_.get(), ZMQ_RCVTIMEO, &patience_ms, sizeof patience_ms);
        if (zmq_bind(socket_.get(), address.c_str()) != 0)
            throw std::runtime_error(address + ": " + zmq_strerror(zmq_errno()));
    }

    // Where it is bound; a port that was asked for as * is a number by now.
    std::string address() const {
        std::string where(256, '\0');
        std::size_t length = where.size();
        zmq_getsockopt(socket_.get(), ZMQ_LAST_ENDPOINT, where.data(), &length);
        return where.c_str();
    }

    // The next request; nothing if there is none for a while, or a signal came first.
    std::optional<std::string> receive() {
        zmq_msg_t message;
        zmq_msg_init(&message);
        std::optional<std::string> bytes;
        if (zmq_msg_recv(&message, socket_.get(), 0) >= 0)
            bytes.emplace(static_cast<const char*>(zmq_msg_data(&message)), zmq_msg_size(&message));
        zmq_msg_close(&message);
        return bytes;
    }

    void send(const std::string& bytes) { zmq_send(socket_.get(), bytes.data(), bytes.size(), 0); }

private:
    std::unique_ptr<void, int (*)(void*)> context_{zmq_ctx_new(), zmq_ctx_term};
    std::unique_ptr<void, int (*)(void*)> socket_{zmq_socket(context_.get(), ZMQ_REP), zmq_close};
};

inline volatile std::sig_atomic_t told_to_stop = 0;

// Answer requests at an address until SIGINT or SIGTERM.
inline void serve(const std::string& address, Bridge& bridge) {
    struct sigaction stop {};
    stop.sa_handler = [](int) { told_to_stop = 1; };
    sigaction(SIGINT, &stop, nullptr);
    sigaction(SIGTERM, &stop, nullptr);
    Socket socket(address);
    std::cout << "Bound to " << socket.address() << std::endl;
    while (!told_to_stop)
        if (auto request = socket.receive()) socket.send(bridge.answer(*request));
}

}  // namespace eigenfail
