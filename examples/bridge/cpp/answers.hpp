// Requests in, answers out: the protocol of docs/bridge.md, version 1, without a socket.
#pragma once

#include <functional>
#include <memory>

#include "episode.hpp"

namespace eigenfail {

inline Value whole(std::uint64_t number) { return {number}; }
inline Value text(std::string words) { return {std::move(words)}; }

class Bridge {
public:
    using Open = std::function<std::unique_ptr<Episode>(const Start&)>;

    Bridge(Description description, Open open)
        : description_(std::move(description)), open_(std::move(open)) {}

    // The answer to a request, whatever it is.
    std::string answer(std::string_view bytes) {
        std::uint64_t id = 0;
        try {
            Value request = Reader::read(bytes);
            if (request["type"].text() == "hello") return Writer::write(hello(request));
            id = request["id"].whole();
            return Writer::write(asked(request, id));
        } catch (const std::exception& error) {
            Map told{{"type", text("error")}, {"id", whole(id)}};
            told.emplace_back("fault", text("simulator"));
            told.emplace_back("message", text(error.what()));
            return Writer::write({std::move(told)});
        }
    }

private:
    static constexpr std::size_t most_sessions = 64;

    struct Slot {
        std::unique_ptr<Episode> episode;
        std::uint64_t step, horizon;
    };
    struct Session {
        std::string name;
        std::vector<Slot> slots;
    };

    Value hello(const Value& request) {
        if (request["protocol"].whole() != 1)
            return {Map{{"type", text("refusal")}, {"reason", text("This is protocol 1.")}}};
        forget(request["session"].text());
        // Nobody says goodbye for a worker that was killed.
        if (sessions_.size() == most_sessions) sessions_.erase(sessions_.begin());
        sessions_.push_back({request["session"].text(), std::vector<Slot>(description_.slots)});
        return welcome();
    }

    Value welcome() const {
        List scenarios, planners;
        for (const auto& [name, dt_s, steps, parameters] : description_.scenarios)
            scenarios.push_back({Map{{"name", text(name)}, {"dt_s", {dt_s}},
                                     {"steps", whole(steps)}, {"parameters", {parameters}}}});
        for (const auto& [name, settings] : description_.planners)
            planners.push_back({Map{{"name", text(name)}, {"settings", {settings}}}});
        return {Map{{"type", text("welcome")}, {"protocol", whole(1)},
                    {"name", text(description_.name)}, {"version", text(description_.version)},
                    {"slots", whole(description_.slots)}, {"scenarios", {std::move(scenarios)}},
                    {"planners", {std::move(planners)}}}};
    }

    Value asked(const Value& request, std::uint64_t id) {
        Session& session = session_of(request["session"].text());
        if (request["type"].text() == "close") {
            forget(std::string(session.name));
            return {Map{{"type", text("closed")}, {"id", whole(id)}}};
        }
        auto act = request["type"].text() == "reset" ? &Bridge::reset : &Bridge::step;
        if (act == &Bridge::step && request["type"].text() != "step")
            throw std::invalid_argument("Nobody knows what this message asks for.");
        List seen;
        for (const Value& each : request["slots"].list())
            seen.push_back(observed(session, act, each));
        return {Map{{"type", text("observations")}, {"id", whole(id)},
                    {"slots", {std::move(seen)}}}};
    }

    using Act = void (Bridge::*)(Slot&, const Value&);

    // What came of it in one slot; a fault ends the episode there.
    Value observed(Session& session, Act act, const Value& each) {
        Slot& slot = session.slots.at(each["slot"].whole());
        try {
            (this->*act)(slot, each);
            return shown(slot);
        } catch (const Fault& fault) {
            return failed(slot, fault.whose, fault.what());
        } catch (const std::exception& error) {
            return failed(slot, "simulator", error.what());
        }
    }

    static Value failed(Slot& slot, const std::string& whose, const std::string& message) {
        slot.episode.reset();
        return {Map{{"fault", text(whose)}, {"message", text(message)}}};
    }

    void reset(Slot& slot, const Value& each) {
        slot.episode.reset();
        const auto& scenario = named(description_.scenarios, each["scenario"].text(), "scenario");
        const auto& planner = named(description_.planners, each["planner"].text(), "planner");
        auto horizon = each["steps"].whole();
        if (horizon < 1 || horizon > scenario.steps) throw Fault("input", "No such horizon.");
        Start start{each["seed"].whole(), scenario.name,
                    {filled(scenario.parameters, each["parameters"])}, planner.name,
                    {filled(planner.settings, each["settings"])}};
        slot = {open_(start), 0, horizon};
    }

    void step(Slot& slot, const Value& each) {
        if (!slot.episode || over(slot))
            throw std::logic_error("There is no episode to go on with.");
        const List& disturbance = each["disturbance"].list();
        slot.episode->step({disturbance.at(0).number(), disturbance.at(1).number()});
        ++slot.step;
    }

    static bool over(const Slot& slot) {
        return slot.step >= slot.horizon || slot.episode->truth().collided;
    }

    static Value shown(const Slot& slot) {
        Truth truth = slot.episode->truth();
        List others;
        for (const Vehicle& other : truth.others) others.push_back(shown(other));
        Map seen{{"step", whole(slot.step)}, {"ego", shown(truth.ego)},
                 {"others", {std::move(others)}}, {"collided", {truth.collided}},
                 {"ended", {over(slot)}}};
        if (truth.perceived) seen.emplace_back("perceived", shown(*truth.perceived));
        if (truth.control) seen.emplace_back("control", shown(*truth.control));
        if (truth.applied) seen.emplace_back("applied", shown(*truth.applied));
        seen.emplace_back("off_road", Value{truth.off_road});
        return {std::move(seen)};
    }

    static Value shown(const Vehicle& one) {
        return {List{{one.x_m}, {one.y_m}, {one.heading_rad}, {one.speed_mps}, {one.length_m},
                     {one.width_m}}};
    }
    static Value shown(const Pair& pair) { return {List{{pair.first}, {pair.second}}}; }

    template <class Known>
    static const Known& named(const std::vector<Known>& all, const std::string& name,
                              const std::string& kind) {
        for (const Known& one : all)
            if (one.name == name) return one;
        throw Fault("input", "There is no " + kind + " of that name.");
    }

    // The defaults, with what was set in their place.
    static Map filled(Map defaults, const Value& given) {
        for (const auto& [name, value] : given.map()) {
            auto is_it = [&name = name](const auto& pair) { return pair.first == name; };
            auto found = std::find_if(defaults.begin(), defaults.end(), is_it);
            if (found == defaults.end())
                throw Fault("input", "There is no parameter of that name.");
            found->second = value;
        }
        return defaults;
    }

    Session& session_of(const std::string& name) {
        for (Session& session : sessions_)
            if (session.name == name) return session;
        throw std::invalid_argument("This session said no hello, or is over.");
    }

    void forget(const std::string& name) {
        auto is_it = [&](const Session& session) { return session.name == name; };
        sessions_.erase(std::remove_if(sessions_.begin(), sessions_.end(), is_it), sessions_.end());
    }

    Description description_;
    Open open_;
    std::vector<Session> sessions_;
};

}  // namespace eigenfail
