// A decoded instruction: what the parser makes of a line of PTX and the interpreter runs.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

namespace fake {

constexpr int kLanes = 32;
constexpr uint32_t kNowhere = 0xffffffff;

// Generic addresses of other spaces than global are an offset plus one of these.
constexpr uint64_t kSharedWindow = 1ull << 48;
constexpr uint64_t kLocalWindow = 2ull << 48;
constexpr uint64_t kParamWindow = 3ull << 48;

// Offsets in shared memory: static variables begin at the first, so that 0 is none, dynamic ones at the second.
constexpr uint32_t kStaticShared = 1024;
constexpr uint32_t kDynamicShared = 1 << 18;
constexpr uint32_t kSharedBytes = 1 << 20;

enum class Kind : uint8_t { bits, natural, integer, real, predicate };

struct Type {
    Kind kind = Kind::bits;
    uint8_t bytes = 0;
};

// Constants live in global memory.
enum class Space : uint8_t { generic, global, shared, local, param };

// What an instruction does to the order of execution. `meet` waits for the lanes it names.
enum class Flow : uint8_t { plain, branch, table, call, ret, leave, barrier, meet };

enum class Rounding : uint8_t { nearest, zero, down, up };

struct Warp;
struct Instruction;
using Run = void (*)(Warp&, const Instruction&, uint32_t mask);

// Registers are offsets into a warp's frame, where each has 32 lanes of its own width. Immediate operands are
// registers that nobody writes.
struct Instruction {
    Run run = nullptr;
    uint32_t r[5] = {kNowhere, kNowhere, kNowhere, kNowhere, kNowhere};
    uint32_t guard = kNowhere;
    uint32_t target = 0;  // of branches: an instruction; of calls and tables: an index
    int64_t offset = 0;   // of addresses
    uint32_t line = 0;
    uint8_t width[2] = {0, 0};  // bytes of the registers r[0] and r[1], where they may differ from the type's
    uint8_t bytes = 0;          // of the type
    uint8_t count = 1;          // of a vector's elements
    uint8_t flops = 0;          // per thread
    Flow flow = Flow::plain;
    Space space = Space::generic;
    Rounding rounding = Rounding::nearest;
    bool guard_negated = false;
    bool extends_sign = false;
    bool strong = false;  // volatile and atomic accesses
    bool flushes = false;
    bool saturates = false;
    bool uncounted = false;    // constants are no traffic
    bool named_count = false;  // a barrier for fewer threads than the block has
};

// A value in every lane of a register: immediates and addresses of variables.
struct Constant {
    uint32_t offset;
    uint8_t bytes;
    uint64_t bits;
};

struct Param {
    std::string name;
    uint32_t offset;
    uint32_t bytes;
    bool pointer;
};

enum class Special : uint8_t {
    tid_x,
    tid_y,
    tid_z,
    ntid_x,
    ntid_y,
    ntid_z,
    ctaid_x,
    ctaid_y,
    ctaid_z,
    nctaid_x,
    nctaid_y,
    nctaid_z,
    laneid,
    warpid,
    nwarpid,
    smid,
    nsmid,
    lanemask_eq,
    lanemask_lt,
    lanemask_le,
    lanemask_gt,
    lanemask_ge,
    dynamic_smem_size,
    total_smem_size,
    gridid,
    clock
};

struct SpecialRegister {
    Special which;
    uint32_t offset;
};

struct Call {
    std::string callee;
    uint32_t function = kNowhere;
    std::vector<uint32_t> arguments;  // offsets into local memory
    std::vector<uint32_t> results;
};

struct SharedVariable {
    std::string name;
    uint32_t offset;
    uint32_t bytes;
};

// Registers and local memory are laid out once per function: there is no recursion.
struct Function {
    std::string name;
    bool kernel = false;
    bool defined = false;
    uint32_t entry = 0;
    uint32_t return_register = kNowhere;
    uint32_t param_bytes = 0;
    uint32_t max_threads = 1024;
    std::vector<Param> params;  // of a device function: offsets into local memory
    std::vector<Param> results;
    std::vector<Constant> constants;
    std::vector<SpecialRegister> specials;
    std::vector<SharedVariable> shared;
    std::vector<Call> calls;
    std::vector<std::vector<uint32_t>> tables;  // targets of indexed branches
};

struct GlobalVariable {
    std::string name;
    uint64_t address;
    uint64_t bytes;
};

struct Program {
    std::vector<Instruction> code;
    std::vector<Function> functions;
    std::vector<std::string> source;  // lines, for messages
    std::vector<GlobalVariable> globals;
    std::vector<SharedVariable> shared;  // declared outside of functions
    uint32_t frame_bytes = 0;            // of all functions together
    uint32_t shared_bytes = 0;           // of static variables, red zones included
    std::vector<uint8_t> local_valid;    // which bytes of a thread's local memory belong to a variable
    int arch = 0;                        // 86 for sm_86
};

// What is wrong with a text that is not the PTX we know.
struct SyntaxError : std::runtime_error {
    SyntaxError(uint32_t line, const std::string& what)
        : std::runtime_error("PTX line " + std::to_string(line) + ": " + what) {}
};

// What went wrong while a kernel ran.
struct Fault : std::runtime_error {
    int code;
    Fault(int code, const std::string& what) : std::runtime_error(what), code(code) {}
};

}  // namespace fake
