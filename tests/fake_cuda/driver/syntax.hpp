// One instruction as it is written, and the names it may use.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "instruction.hpp"

namespace fake {

struct Operand {
    enum Form { name, number, address, vector, absent } form = absent;
    std::string text;  // a name or a number; of an address its base, empty if absolute
    std::vector<Operand> parts;
    int64_t offset = 0;
    bool negated = false;
    bool paired = false;  // `p|q`: the next one belongs to it
};

struct Statement {
    uint32_t line = 0;
    std::string opcode;  // up to the first dot
    std::vector<std::string> modifiers;
    std::vector<Operand> operands;
    Operand guard;
};

// What a name stands for.
struct Symbol {
    enum Form { reg, global, shared, local, kernel_param } form;
    uint8_t bytes = 0;   // of a register
    uint64_t where = 0;  // offset in its space, or the address in global memory
    uint64_t size = 0;
};

// Turns the statements of a function into instructions.
class Builder {
   public:
    Builder(Program& program, uint32_t function) : program(program), index(function) {}

    Program& program;
    uint32_t index;
    std::vector<std::map<std::string, Symbol>> scopes;  // outermost first
    std::map<std::string, uint32_t> labels;
    std::vector<std::pair<uint32_t, std::string>> jumps;  // instructions whose target is a label
    std::map<std::string, std::vector<std::string>> tables;
    std::map<std::string, uint32_t> table_index;

    Function& function() const { return program.functions[index]; }
    const Symbol* find(const std::string& name) const;
    uint32_t allocate_register(uint32_t bytes);
    uint32_t allocate_local(uint64_t bytes, uint64_t align);
    uint32_t constant(uint8_t bytes, uint64_t bits);
    uint32_t special(const std::string& name);  // kNowhere if there is none
    void resolve_labels();

   private:
    std::map<std::pair<uint8_t, uint64_t>, uint32_t> constants_;
};

// One statement on its way to becoming an instruction. Modifiers are taken one by one: what is left is unknown.
class Decoder {
   public:
    Decoder(Builder& builder, const Statement& statement);

    Builder& builder;
    const Statement& statement;
    Instruction out;

    bool take(const char* modifier);
    Type take_type();
    Rounding take_rounding();
    Space take_space();
    size_t operand_count() const { return statement.operands.size(); }
    const Operand& operand(size_t k);

    // The register of an operand, or one made for an immediate, that is `bytes` wide.
    uint32_t source(size_t k, uint32_t bytes) { return source(operand(k), bytes); }
    uint32_t source(const Operand& operand, uint32_t bytes);
    uint32_t target(size_t k, uint32_t bytes) { return target(operand(k), bytes); }
    uint32_t target(const Operand& operand, uint32_t bytes);
    const Symbol* symbol_of(const Operand& operand) const { return builder.find(operand.text); }
    uint8_t width_of(const Operand& operand, uint8_t otherwise) const;

    void emit(Run run);
    [[noreturn]] void reject(const std::string& why) const;

   private:
    std::vector<std::string> left_;
};

using Decode = void (*)(Decoder&);
using DecodeTable = std::map<std::string, Decode>;

// Each file of the decoder adds its instructions.
void add_integer_instructions(DecodeTable& table);
void add_bit_instructions(DecodeTable& table);
void add_float_instructions(DecodeTable& table);
void add_compare_instructions(DecodeTable& table);
void add_conversion_instructions(DecodeTable& table);
void add_memory_instructions(DecodeTable& table);
void add_move_instructions(DecodeTable& table);
void add_atomic_instructions(DecodeTable& table);
void add_control_instructions(DecodeTable& table);
void add_warp_instructions(DecodeTable& table);

// Directed roundings, flushing of subnormals and saturation; null where that is not known.
Run careful_unary(const std::string& opcode, uint8_t bytes);
Run careful_binary(const std::string& opcode, uint8_t bytes);
Run careful_fma(uint8_t bytes);

bool parse_type(const std::string& text, Type* type);
uint64_t parse_number(const std::string& text, uint32_t line);

// Reads a module. Variables are allocated in `memory`; throws SyntaxError.
class DeviceMemory;
Program parse(const std::string& source, DeviceMemory& memory);

}  // namespace fake
