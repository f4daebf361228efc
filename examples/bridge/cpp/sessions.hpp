// Who is served, and with which episodes. Nobody says goodbye for a worker that was killed.
#pragma once

#include <chrono>
#include <tuple>

#include "episode.hpp"

namespace eigenfail {

struct Slot {
    std::unique_ptr<Episode> episode;
    std::uint64_t step, horizon;
    bool explain;

    bool over() const { return step >= horizon || episode->truth().collided; }
    bool runs() const { return episode && !over(); }
};

using Clock = std::chrono::steady_clock;

struct Session {
    std::string name;
    std::vector<Slot> slots;
    Clock::time_point asked;

    bool idle() const {
        return std::none_of(slots.begin(), slots.end(), [](const Slot& slot) { return slot.runs(); });
    }
};

// Throw it for a session that nobody knows: its worker begins another one.
struct Unknown : std::runtime_error {
    using std::runtime_error::runtime_error;
};

class Sessions {
public:
    static constexpr std::size_t most = 64;

    // Who has asked nothing for so long is gone, if its room is needed.
    explicit Sessions(Clock::duration patience) : patience_(patience) {}

    // Begin a session; no if all others are in use.
    bool begin(const std::string& name, std::size_t slots) {
        forget(name);
        if (all_.size() >= most && !make_room()) return false;
        all_.push_back({name, std::vector<Slot>(slots), Clock::now()});
        return true;
    }

    Session& of(const std::string& name) {
        for (Session& session : all_)
            if (session.name == name) {
                session.asked = Clock::now();
                return session;
            }
        throw Unknown("This session said no hello, or is over.");
    }

    void forget(const std::string& name) {
        auto is_it = [&](const Session& session) { return session.name == name; };
        all_.erase(std::remove_if(all_.begin(), all_.end(), is_it), all_.end());
    }

private:
    // Idle ones go first, and of those the one that has not asked for longest.
    bool make_room() {
        auto now = Clock::now();
        auto may_go = [&](const Session& one) { return one.idle() || now - one.asked >= patience_; };
        auto sooner = [&](const Session& one, const Session& other) {
            auto rank = [&](const Session& each) {
                return std::make_tuple(!may_go(each), !each.idle(), each.asked);
            };
            return rank(one) < rank(other);
        };
        auto first = std::min_element(all_.begin(), all_.end(), sooner);
        if (!may_go(*first)) return false;
        all_.erase(first);
        return true;
    }

    Clock::duration patience_;
    std::vector<Session> all_;
};

}  // namespace eigenfail
