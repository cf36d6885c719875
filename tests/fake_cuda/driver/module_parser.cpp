// What stands outside of functions: versions, variables, prototypes.
#include <cstdlib>
#include <cstring>
#include <sstream>

#include "memory.hpp"
#include "reader.hpp"

namespace fake {
namespace {

std::string trimmed(std::string line) {
    std::replace(line.begin(), line.end(), '\t', ' ');
    const size_t start = line.find_first_not_of(' ');
    return start == std::string::npos ? "" : line.substr(start);
}

class ModuleParser {
   public:
    ModuleParser(const std::string& source, DeviceMemory& memory) : memory_(memory), reader_(source) {
        std::istringstream lines(source);
        for (std::string line; std::getline(lines, line);) program_.source.push_back(trimmed(line));
        program_.source.emplace_back();
        program_.shared_bytes = kStaticShared;
    }

    Program run() {
        while (!reader_.at_end()) item();
        resolve_calls();
        return std::move(program_);
    }

   private:
    void item() {
        bool external = false;
        while (reader_.at(".visible") || reader_.at(".weak") || reader_.at(".common") || reader_.at(".extern"))
            external |= reader_.next().is(".extern");
        if (reader_.at(".version") || reader_.at(".file") || reader_.at(".address_size")) reader_.skip_line();
        else if (reader_.accept(".target")) target();
        else if (reader_.accept(".section")) reader_.skip_braces();
        else if (reader_.accept(".pragma")) reader_.skip_line();
        else if (reader_.accept(".entry")) parse_function(reader_, program_, scope_, true);
        else if (reader_.accept(".func")) parse_function(reader_, program_, scope_, false);
        else if (reader_.accept(".global") || reader_.accept(".const")) global_variable(external);
        else if (reader_.accept(".shared")) shared_variable();
        else reader_.reject_word();
    }

    void target() {
        const std::string name = reader_.here().text_;
        if (name.rfind("sm_", 0) != 0) reader_.reject("the target " + name + " is no architecture");
        program_.arch = std::atoi(name.c_str() + 3);
        reader_.skip_line();
    }

    void global_variable(bool external) {
        const Declaration d = reader_.declaration();
        if (external || d.unsized) reader_.reject("the variable " + d.name + " would need another module");
        const uint64_t address = memory_.allocate(d.bytes);
        if (!address) reader_.reject("no memory for " + d.name);
        program_.globals.push_back({d.name, address, d.bytes});
        scope_[d.name] = {Symbol::global, 0, address, d.bytes};
        uint8_t* data = memory_.view(address, d.bytes);
        std::memset(data, 0, d.bytes);
        memory_.mark_written(address, d.bytes);
        if (reader_.accept("=")) initialise(d, data);
        reader_.expect(";");
    }

    void initialise(const Declaration& d, uint8_t* data) {
        const bool list = reader_.accept("{");
        uint64_t at = 0;
        do {
            if (at + d.type.bytes > d.bytes) reader_.reject("more values than " + d.name + " holds");
            const uint64_t value = initial_value();
            std::memcpy(data + at, &value, d.type.bytes);
            at += d.type.bytes;
        } while (list && reader_.accept(","));
        if (list) reader_.expect("}");
    }

    // A number or the address of a variable.
    uint64_t initial_value() {
        const bool negative = reader_.accept("-");
        if (reader_.here().form == Token::number) return negative ? 0 - reader_.number() : reader_.number();
        const bool generic = reader_.accept("generic");
        if (generic) reader_.expect("(");
        const auto found = scope_.find(reader_.here().text_);
        if (found == scope_.end() || found->second.form != Symbol::global) reader_.reject_word();
        reader_.next();
        if (generic) reader_.expect(")");
        return found->second.where;
    }

    void shared_variable() {
        const Declaration d = reader_.declaration();
        reader_.expect(";");
        add_shared(program_, d, program_.shared, scope_);
    }

    void resolve_calls() {
        for (Function& f : program_.functions)
            for (Call& call : f.calls)
                for (uint32_t k = 0; k < program_.functions.size(); ++k)
                    if (program_.functions[k].name == call.callee) call.function = k;
        std::vector<State> states(program_.functions.size(), State::unseen);
        for (uint32_t k = 0; k < program_.functions.size(); ++k) visit(k, states);
    }

    enum class State : uint8_t { unseen, open, done };

    // Registers exist once per function, so nothing may call itself, and every callee must be here.
    void visit(uint32_t k, std::vector<State>& states) {
        if (states[k] == State::done) return;
        const Function& f = program_.functions[k];
        if (states[k] == State::open) throw SyntaxError(1, "the function " + f.name + " calls itself");
        states[k] = State::open;
        for (const Call& call : f.calls) {
            if (call.function == kNowhere || !program_.functions[call.function].defined)
                throw SyntaxError(1, "no function " + call.callee + " in this module");
            visit(call.function, states);
        }
        states[k] = State::done;
    }

    DeviceMemory& memory_;
    Reader reader_;
    Program program_;
    Scope scope_;
};

}  // namespace

Program parse(const std::string& source, DeviceMemory& memory) { return ModuleParser(source, memory).run(); }

}  // namespace fake
