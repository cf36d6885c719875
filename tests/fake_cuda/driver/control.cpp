// Branches, calls, barriers.
#include "lanes.hpp"

namespace fake {
namespace {

void run_nothing(Warp&, const Instruction&, uint32_t) {}

void decode_branch(Decoder& d) {
    d.take("uni");
    d.out.flow = Flow::branch;
    d.builder.jumps.emplace_back(d.builder.program.code.size(), d.operand(0).text);
    d.emit(nullptr);
}

// brx.idx index, name of a list of labels
void decode_table(Decoder& d) {
    d.take("idx");
    d.take("uni");
    d.out.flow = Flow::table;
    d.out.r[1] = d.source(0, 4);
    auto& tables = d.builder.function().tables;
    d.builder.table_index[d.operand(1).text] = static_cast<uint32_t>(tables.size());
    d.out.offset = static_cast<int64_t>(tables.size());
    d.out.target = d.builder.index;
    tables.emplace_back();
    d.emit(nullptr);
}

// What a function returned goes to the variables of the caller.
void run_collect(Warp& w, const Instruction& i, uint32_t mask) {
    const Program& program = w.block.launch.program;
    const Call& made = program.functions[static_cast<size_t>(i.offset)].calls[i.target];
    const Function& callee = program.functions[made.function];
    const size_t stride = program.local_valid.size();
    for_lanes(w, mask, [&](int lane) {
        uint8_t* local = w.block.local.data() + (w.first + static_cast<uint32_t>(lane)) * stride;
        for (size_t k = 0; k < made.results.size(); ++k)
            std::memcpy(local + made.results[k], local + callee.results[k].offset, callee.results[k].bytes);
    });
}

void run_assert(Warp& w, const Instruction&, uint32_t mask) {
    fail(w, __builtin_ctz(mask), kAssert, "device-side assertion failed");
}

std::vector<uint32_t> variables(Decoder& d, const Operand& list) {
    std::vector<uint32_t> places;
    for (const Operand& part : list.parts) {
        const Symbol* symbol = d.symbol_of(part);
        if (!symbol || symbol->form != Symbol::local) d.reject("an argument that is no variable");
        places.push_back(static_cast<uint32_t>(symbol->where));
    }
    return places;
}

// call [(results),] name [, (arguments)]
void decode_call(Decoder& d) {
    d.take("uni");
    Call call;
    size_t at = 0;
    if (d.operand(0).form == Operand::vector) call.results = variables(d, d.operand(at++));
    call.callee = d.operand(at).text;
    if (d.symbol_of(d.operand(at))) d.reject("calls through registers are not known");
    if (call.callee == "__assertfail") return d.emit(run_assert);
    if (d.operand_count() > at + 1) call.arguments = variables(d, d.operand(at + 1));
    if (d.operand_count() > at + 2) d.reject("calls through registers are not known");
    d.out.flow = Flow::call;
    d.out.target = static_cast<uint32_t>(d.builder.function().calls.size());
    d.out.offset = d.builder.index;
    d.builder.function().calls.push_back(call);
    d.emit(nullptr);
    d.out.flow = Flow::plain;
    d.emit(run_collect);
}

void decode_return(Decoder& d) {
    d.take("uni");
    const bool leaves = d.builder.function().kernel || d.statement.opcode == "exit";
    d.out.flow = leaves ? Flow::leave : Flow::ret;
    d.out.target = d.builder.index;
    d.emit(nullptr);
}

void run_trap(Warp& w, const Instruction&, uint32_t mask) { fail(w, __builtin_ctz(mask), kLaunchFailed, "trap"); }

void run_warp_barrier(Warp& w, const Instruction&, uint32_t) { ++w.epoch; }

// Waits with r[1] the barrier, r[2] the number of threads if it is given, and of bar.red r[3] what is combined.
void decode_barrier(Decoder& d) {
    if (d.take("warp")) {
        d.take("sync");
        d.out.flow = Flow::meet;
        d.out.r[4] = d.source(0, 4);
        return d.emit(run_warp_barrier);
    }
    d.take("cta");
    d.take("aligned");
    d.out.flow = Flow::barrier;
    size_t at = 0;
    const bool combines = d.take("red");
    if (combines) {
        const Type type = d.take_type();
        d.out.bytes = type.bytes;
        d.out.count = d.take("and") ? 1 : (d.take("or") || d.take("popc"), 2);
        d.out.r[0] = d.target(at++, type.bytes);
    } else if (!d.take("sync")) {
        d.reject("barriers that do not wait are not known");
    }
    const size_t last = d.operand_count() - (combines ? 1 : 0);
    d.out.r[1] = d.source(at++, 4);
    d.out.named_count = at < last;
    if (d.out.named_count) d.out.r[2] = d.source(at++, 4);
    if (combines) {
        d.out.extends_sign = d.operand(at).negated;
        d.out.r[3] = d.source(at, 1);
    }
    d.emit(nullptr);
}

}  // namespace

void add_control_instructions(DecodeTable& table) {
    table["bra"] = decode_branch;
    table["brx"] = decode_table;
    table["call"] = decode_call;
    table["ret"] = decode_return;
    table["exit"] = decode_return;
    table["trap"] = [](Decoder& d) { d.emit(run_trap); };
    table["bar"] = decode_barrier;
    table["barrier"] = decode_barrier;
    table["nanosleep"] = [](Decoder& d) {
        d.take_type();
        d.emit(run_nothing);
    };
}

}  // namespace fake
