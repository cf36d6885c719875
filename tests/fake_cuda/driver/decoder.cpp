// What all instructions have in common: operands, modifiers, immediates.
#include <algorithm>
#include <cstdlib>
#include <cstring>

#include "syntax.hpp"

namespace fake {

bool parse_type(const std::string& text, Type* type) {
    if (text == "pred") return *type = {Kind::predicate, 1}, true;
    if (text.size() < 2) return false;
    const std::string bits = text.substr(1);
    const int bytes = bits == "8" ? 1 : bits == "16" ? 2 : bits == "32" ? 4 : bits == "64" ? 8 : 0;
    const char* kinds = "busf";
    const char* kind = std::strchr(kinds, text[0]);
    if (!bytes || !kind || (*kind == 'f' && bytes < 4)) return false;
    *type = {static_cast<Kind>(kind - kinds), static_cast<uint8_t>(bytes)};
    return true;
}

uint64_t parse_number(const std::string& text, uint32_t line) {
    if (text == "WARP_SZ") return kLanes;
    const bool hexadecimal_real = text.size() > 2 && text[0] == '0' && std::strchr("fFdD", text[1]);
    char* end = nullptr;
    uint64_t value = 0;
    if (hexadecimal_real) value = std::strtoull(text.c_str() + 2, &end, 16);
    else value = std::strtoull(text.c_str(), &end, 0);
    if (*end == 'U') ++end;
    if (*end) throw SyntaxError(line, "the number " + text + " is of no known form");
    return value;
}

const Symbol* Builder::find(const std::string& name) const {
    for (auto scope = scopes.rbegin(); scope != scopes.rend(); ++scope) {
        const auto found = scope->find(name);
        if (found != scope->end()) return &found->second;
    }
    return nullptr;
}

// Frames of all functions lie behind one another, each register at a multiple of a cache line.
uint32_t Builder::allocate_register(uint32_t bytes) {
    const uint32_t offset = program.frame_bytes;
    program.frame_bytes += (bytes * kLanes + 63) / 64 * 64;
    return offset;
}

uint32_t Builder::allocate_local(uint64_t bytes, uint64_t align) {
    auto& valid = program.local_valid;
    constexpr uint64_t red_zone = 16;
    const uint64_t start = (valid.size() + red_zone + align - 1) / align * align;
    valid.resize(start, 0);
    valid.resize(start + bytes, 1);
    valid.resize((start + bytes + red_zone + 15) / 16 * 16, 0);
    return static_cast<uint32_t>(start);
}

uint32_t Builder::constant(uint8_t bytes, uint64_t bits) {
    if (bytes < 8) bits &= (1ull << 8 * bytes) - 1;
    const auto [found, is_new] = constants_.try_emplace({bytes, bits}, 0);
    if (is_new) {
        found->second = allocate_register(bytes);
        function().constants.push_back({found->second, bytes, bits});
    }
    return found->second;
}

uint32_t Builder::special(const std::string& name) {
    static const std::map<std::string, Special> names = {{"%tid.x", Special::tid_x},
                                                         {"%tid.y", Special::tid_y},
                                                         {"%tid.z", Special::tid_z},
                                                         {"%ntid.x", Special::ntid_x},
                                                         {"%ntid.y", Special::ntid_y},
                                                         {"%ntid.z", Special::ntid_z},
                                                         {"%ctaid.x", Special::ctaid_x},
                                                         {"%ctaid.y", Special::ctaid_y},
                                                         {"%ctaid.z", Special::ctaid_z},
                                                         {"%nctaid.x", Special::nctaid_x},
                                                         {"%nctaid.y", Special::nctaid_y},
                                                         {"%nctaid.z", Special::nctaid_z},
                                                         {"%laneid", Special::laneid},
                                                         {"%warpid", Special::warpid},
                                                         {"%nwarpid", Special::nwarpid},
                                                         {"%smid", Special::smid},
                                                         {"%nsmid", Special::nsmid},
                                                         {"%lanemask_eq", Special::lanemask_eq},
                                                         {"%lanemask_lt", Special::lanemask_lt},
                                                         {"%lanemask_le", Special::lanemask_le},
                                                         {"%lanemask_gt", Special::lanemask_gt},
                                                         {"%lanemask_ge", Special::lanemask_ge},
                                                         {"%dynamic_smem_size", Special::dynamic_smem_size},
                                                         {"%total_smem_size", Special::total_smem_size},
                                                         {"%gridid", Special::gridid}};
    const auto found = names.find(name);
    if (found == names.end()) return kNowhere;
    for (const SpecialRegister& s : function().specials)
        if (s.which == found->second) return s.offset;
    function().specials.push_back({found->second, allocate_register(4)});
    return function().specials.back().offset;
}

void Builder::resolve_labels() {
    const auto place = [&](const std::string& label) {
        const auto found = labels.find(label);
        if (found == labels.end()) throw SyntaxError(program.code[function().entry].line, "no label " + label);
        return found->second;
    };
    for (const auto& [instruction, label] : jumps) program.code[instruction].target = place(label);
    for (const auto& [name, index] : table_index) {
        auto& targets = function().tables[index];
        for (const std::string& label : tables[name]) targets.push_back(place(label));
    }
}

Decoder::Decoder(Builder& builder, const Statement& statement)
    : builder(builder), statement(statement), left_(statement.modifiers) {
    out.line = statement.line;
    if (statement.guard.form == Operand::absent) return;
    out.guard = source(statement.guard, 1);
    out.guard_negated = statement.guard.negated;
}

void Decoder::reject(const std::string& why) const { throw SyntaxError(statement.line, why); }

bool Decoder::take(const char* modifier) {
    const auto found = std::find(left_.begin(), left_.end(), modifier);
    if (found == left_.end()) return false;
    left_.erase(found);
    return true;
}

// The first modifier that is a type.
Type Decoder::take_type() {
    Type type;
    for (auto m = left_.begin(); m != left_.end(); ++m)
        if (parse_type(*m, &type)) {
            left_.erase(m);
            return type;
        }
    reject("'" + statement.opcode + "' without a type that is known here");
}

Rounding Decoder::take_rounding() {
    if (take("rz")) return Rounding::zero;
    if (take("rm")) return Rounding::down;
    if (take("rp")) return Rounding::up;
    take("rn");
    return Rounding::nearest;
}

Space Decoder::take_space() {
    if (take("global") || take("const")) return Space::global;
    if (take("shared") || take("shared::cta")) return Space::shared;
    if (take("local")) return Space::local;
    if (take("param")) return Space::param;
    return Space::generic;
}

const Operand& Decoder::operand(size_t k) {
    if (k >= statement.operands.size()) reject("'" + statement.opcode + "' needs more operands");
    return statement.operands[k];
}

uint8_t Decoder::width_of(const Operand& operand, uint8_t otherwise) const {
    const Symbol* symbol = symbol_of(operand);
    return symbol && symbol->form == Symbol::reg ? symbol->bytes : otherwise;
}

uint32_t Decoder::source(const Operand& operand, uint32_t bytes) {
    if (operand.form == Operand::number) {
        uint64_t bits = parse_number(operand.text, statement.line);
        return builder.constant(static_cast<uint8_t>(bytes), operand.negated ? 0 - bits : bits);
    }
    if (operand.form != Operand::name) reject("an operand of an unexpected form");
    const uint32_t special = builder.special(operand.text);
    if (special != kNowhere) return special;
    const Symbol* symbol = symbol_of(operand);
    if (symbol && symbol->form != Symbol::reg)
        return builder.constant(static_cast<uint8_t>(bytes), symbol->where + static_cast<uint64_t>(operand.offset));
    return target(operand, bytes);
}

uint32_t Decoder::target(const Operand& operand, uint32_t bytes) {
    if (operand.text == "_") return builder.allocate_register(bytes);
    const Symbol* symbol = symbol_of(operand);
    if (!symbol || symbol->form != Symbol::reg) reject("no register is called '" + operand.text + "'");
    if (symbol->bytes != bytes)
        reject(operand.text + " has " + std::to_string(symbol->bytes) + " bytes, the instruction wants " +
               std::to_string(bytes));
    return static_cast<uint32_t>(symbol->where);
}

void Decoder::emit(Run run) {
    if (!run && out.flow == Flow::plain) reject("'" + statement.opcode + "' is not known for this type");
    if (!left_.empty()) reject("'" + statement.opcode + "' with '." + left_.front() + "' is not known");
    out.run = run;
    builder.program.code.push_back(out);
}

}  // namespace fake
