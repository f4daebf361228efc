// Requests in, answers out: the protocol of docs/bridge.md, without a socket.
#pragma once

#include <functional>

#include "parameters.hpp"
#include "sessions.hpp"

namespace eigenfail {

inline Value whole(std::uint64_t number) { return {number}; }
inline Value text(std::string words) { return {std::move(words)}; }

class Bridge {
public:
    using Open = std::function<std::unique_ptr<Episode>(const Start&)>;

    // Who has asked nothing for the time of patience makes room for others, if there is none.
    Bridge(Description description, Open open, Clock::duration patience = std::chrono::minutes(1))
        : description_(std::move(description)), open_(std::move(open)), sessions_(patience) {}

    // The answer to a request, whatever it is.
    std::string answer(std::string_view bytes) {
        std::uint64_t id = 0;
        try {
            Value request = Reader::read(bytes);
            if (request["type"].text() == "hello") return Writer::write(hello(request));
            id = request["id"].whole();
            return Writer::write(asked(request, id));
        } catch (const Unknown& error) {
            Map told = trouble(id, error);
            told.emplace_back("lost", Value{true});
            return Writer::write({std::move(told)});
        } catch (const std::exception& error) {
            return Writer::write({trouble(id, error)});
        }
    }

private:
    static constexpr std::uint64_t protocol = 2;

    static Map trouble(std::uint64_t id, const std::exception& error) {
        return {{"type", text("error")}, {"id", whole(id)}, {"fault", text("simulator")},
                {"message", text(error.what())}};
    }

    static Value refusal(const char* reason, bool full) {
        Map told{{"type", text("refusal")}, {"reason", text(reason)}};
        if (full) told.emplace_back("full", Value{true});
        return {std::move(told)};
    }

    Value hello(const Value& request) {
        if (request["protocol"].whole() != protocol)
            return refusal("This is protocol 2.", false);
        if (!sessions_.begin(request["session"].text(), description_.slots))
            return refusal("All sessions are in use.", true);
        return welcome();
    }

    Value welcome() const {
        List scenarios, planners, channels, signals;
        for (const auto& [name, dt_s, steps, parameters] : description_.scenarios)
            scenarios.push_back({Map{{"name", text(name)}, {"dt_s", {dt_s}},
                                     {"steps", whole(steps)}, {"parameters", {parameters}}}});
        for (const auto& [name, settings] : description_.planners)
            planners.push_back({Map{{"name", text(name)}, {"settings", {settings}}}});
        Map told{{"type", text("welcome")}, {"protocol", whole(protocol)},
                 {"name", text(description_.name)}, {"version", text(description_.version)},
                 {"slots", whole(description_.slots)}, {"scenarios", {std::move(scenarios)}},
                 {"planners", {std::move(planners)}}};
        for (const std::string& name : description_.channels) channels.push_back(text(name));
        for (const auto& [name, unit, words] : description_.signals)
            signals.push_back(
                {Map{{"name", text(name)}, {"unit", text(unit)}, {"words", text(words)}}});
        if (!channels.empty()) told.emplace_back("channels", Value{std::move(channels)});
        told.emplace_back("signals", Value{std::move(signals)});
        told.emplace_back("seed_text", Value{false});
        return {std::move(told)};
    }

    Value asked(const Value& request, std::uint64_t id) {
        Session& session = sessions_.of(request["session"].text());
        if (request["type"].text() == "close") {
            sessions_.forget(std::string(session.name));
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
        List channels = each["channels"].list();
        for (const Value& channel : channels)
            if (!description_.disturbs(channel["name"].text()))
                throw Fault("input", "There is no channel of that name.");
        Start start{each["seed"].whole(), scenario.name,
                    {filled(scenario.parameters, each["parameters"])}, planner.name,
                    {filled(planner.settings, each["settings"])}, std::move(channels)};
        bool explain = !each["explain"].empty() && each["explain"].truth();
        slot = {open_(start), 0, horizon, explain};
    }

    void step(Slot& slot, const Value& each) {
        if (!slot.runs())
            throw std::logic_error("There is no episode to go on with.");
        slot.episode->step({each["disturbances"].map()});
        ++slot.step;
    }

    static Value shown(const Slot& slot) {
        Truth truth = slot.episode->truth();
        List others;
        for (const Vehicle& other : truth.others) others.push_back(shown(other));
        Map seen{{"step", whole(slot.step)}, {"ego", shown(truth.ego)},
                 {"others", {std::move(others)}}, {"collided", {truth.collided}},
                 {"ended", {slot.over()}}};
        if (truth.perceived) seen.emplace_back("perceived", shown(*truth.perceived));
        if (truth.control) seen.emplace_back("control", shown(*truth.control));
        if (truth.applied) seen.emplace_back("applied", shown(*truth.applied));
        seen.emplace_back("off_road", Value{truth.off_road});
        if (!truth.ids.empty()) seen.emplace_back("ids", Value{std::move(truth.ids)});
        if (!truth.signals.empty()) seen.emplace_back("signals", Value{std::move(truth.signals)});
        if (!slot.explain || slot.step == 0) return {std::move(seen)};
        List path;
        for (const Pair& point : truth.path) path.push_back(shown(point));
        seen.emplace_back("account", Value{std::move(truth.account)});
        seen.emplace_back("path", Value{std::move(path)});
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

    Description description_;
    Open open_;
    Sessions sessions_;
};

}  // namespace eigenfail
