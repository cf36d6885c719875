// A function: its parameters, then statement by statement.
#include "reader.hpp"

namespace fake {

const DecodeTable& instructions() {
    static const DecodeTable table = [] {
        DecodeTable t;
        for (auto add :
             {add_integer_instructions, add_bit_instructions, add_float_instructions, add_compare_instructions,
              add_conversion_instructions, add_memory_instructions, add_move_instructions, add_atomic_instructions,
              add_control_instructions, add_warp_instructions})
            add(t);
        return t;
    }();
    return table;
}

namespace {

uint32_t index_of(Program& program, const std::string& name) {
    for (uint32_t k = 0; k < program.functions.size(); ++k)
        if (program.functions[k].name == name) return k;
    program.functions.emplace_back();
    program.functions.back().name = name;
    return static_cast<uint32_t>(program.functions.size() - 1);
}

class FunctionParser {
   public:
    FunctionParser(Reader& reader, Program& program, const Scope& scope, bool kernel)
        : reader_(reader), program_(program), module_scope_(scope), kernel_(kernel) {}

    void run() {
        std::vector<Declaration> results;
        if (reader_.at("(")) results = in_parentheses();
        Builder builder(program_, index_of(program_, reader_.next().text_));
        builder_ = &builder;
        builder.scopes = {module_scope_, {}};
        Function& f = builder.function();
        f.kernel = kernel_;
        std::vector<Declaration> params;
        if (reader_.at("(")) params = in_parentheses();
        directives();
        if (reader_.accept(";")) return;
        kernel_ ? kernel_params(params) : local_params(params, f.params);
        local_params(results, f.results);
        f.return_register = builder.allocate_register(4);
        f.defined = true;
        f.entry = static_cast<uint32_t>(program_.code.size());
        body();
        finish();
        builder.resolve_labels();
    }

   private:
    std::vector<Declaration> in_parentheses() {
        std::vector<Declaration> found;
        reader_.expect("(");
        while (!reader_.accept(")")) {
            if (!reader_.accept(".param") && !reader_.accept(".reg")) reader_.reject_word();
            found.push_back(reader_.declaration());
            reader_.accept(",");
        }
        return found;
    }

    void kernel_params(const std::vector<Declaration>& declared) {
        Function& f = builder_->function();
        for (const Declaration& d : declared) {
            const auto start = static_cast<uint32_t>((f.param_bytes + d.align - 1) / d.align * d.align);
            f.params.push_back({d.name, start, static_cast<uint32_t>(d.bytes), d.pointer});
            builder_->scopes.back()[d.name] = {Symbol::kernel_param, 0, start, d.bytes};
            f.param_bytes = start + static_cast<uint32_t>(d.bytes);
        }
    }

    void local_params(const std::vector<Declaration>& declared, std::vector<Param>& list) {
        for (const Declaration& d : declared) {
            const uint32_t start = builder_->allocate_local(d.bytes, d.align);
            list.push_back({d.name, start, static_cast<uint32_t>(d.bytes), false});
            builder_->scopes.back()[d.name] = {Symbol::local, 0, start, d.bytes};
        }
    }

    void directives() {
        while (reader_.here().text_[0] == '.') {
            const bool threads = reader_.at(".maxntid") || reader_.at(".reqntid");
            reader_.next();
            uint64_t product = 1;
            while (reader_.here().form == Token::number) {
                product *= reader_.number();
                reader_.accept(",");
            }
            if (threads) builder_->function().max_threads = static_cast<uint32_t>(product);
        }
    }

    void body() {
        reader_.expect("{");
        for (int depth = 1; depth;) {
            if (reader_.at_end()) reader_.reject("the body has no end");
            if (reader_.accept("{")) {
                ++depth;
                builder_->scopes.emplace_back();
            } else if (reader_.accept("}")) {
                --depth;
                builder_->scopes.pop_back();
            } else {
                item();
            }
        }
    }

    void item() {
        if (reader_.at(".loc")) return reader_.skip_line();
        if (reader_.at(".pragma")) return reader_.skip_line();
        if (reader_.accept(".reg")) return registers();
        if (reader_.accept(".local")) return local_variable();
        if (reader_.accept(".param")) return local_variable();
        if (reader_.accept(".shared")) {
            add_shared(program_, reader_.declaration(), builder_->function().shared, builder_->scopes.back());
            return reader_.expect(";");
        }
        if (reader_.here().form == Token::name && reader_.ahead().is(":")) return label();
        if (reader_.here().text_[0] == '.') reader_.reject_word();
        statement();
    }

    void registers() {
        const Declaration first = reader_.declaration();
        add_register(first, first.type.bytes);
        while (reader_.accept(",")) add_register(reader_.declaration(), first.type.bytes);
        reader_.expect(";");
    }

    void add_register(const Declaration& d, uint8_t bytes) {
        Scope& scope = builder_->scopes.back();
        if (!d.copies) scope[d.name] = {Symbol::reg, bytes, builder_->allocate_register(bytes), bytes};
        for (uint64_t k = 0; k < d.copies; ++k)
            scope[d.name + std::to_string(k)] = {Symbol::reg, bytes, builder_->allocate_register(bytes), bytes};
    }

    // Parameters of calls are variables of the caller, too.
    void local_variable() {
        const Declaration d = reader_.declaration();
        reader_.expect(";");
        builder_->scopes.back()[d.name] = {Symbol::local, 0, builder_->allocate_local(d.bytes, d.align), d.bytes};
    }

    void label() {
        const std::string name = reader_.next().text_;
        reader_.expect(":");
        builder_->labels[name] = static_cast<uint32_t>(program_.code.size());
        if (!reader_.accept(".branchtargets")) return;
        builder_->labels.erase(name);
        do builder_->tables[name].push_back(reader_.next().text_);
        while (reader_.accept(","));
        reader_.expect(";");
    }

    void statement() {
        Statement s;
        if (reader_.accept("@")) {
            s.guard.negated = reader_.accept("!");
            s.guard.form = Operand::name;
            s.guard.text = reader_.next().text_;
        }
        s.line = reader_.here().line;
        split_opcode(reader_.next().text_, s);
        while (!reader_.accept(";")) {
            s.operands.push_back(operand());
            s.operands.back().paired = reader_.accept("|");
            if (!s.operands.back().paired && !reader_.accept(",") && !reader_.at(";")) reader_.reject_word();
        }
        const auto decode = instructions().find(s.opcode);
        if (decode == instructions().end())
            throw SyntaxError(s.line, "the instruction '" + s.opcode + "' is not known");
        Decoder decoder(*builder_, s);
        decode->second(decoder);
    }

    static void split_opcode(const std::string& word, Statement& s) {
        size_t start = word.find('.');
        s.opcode = word.substr(0, start);
        while (start != std::string::npos) {
            const size_t end = word.find('.', start + 1);
            s.modifiers.push_back(word.substr(start + 1, end == std::string::npos ? end : end - start - 1));
            start = end;
        }
    }

    Operand operand() {
        if (reader_.at("[")) return address();
        Operand found;
        if (reader_.at("{") || reader_.at("(")) {
            const char* close = reader_.next().is("{") ? "}" : ")";
            found.form = Operand::vector;
            while (!reader_.accept(close)) {
                found.parts.push_back(operand());
                reader_.accept(",");
            }
            return found;
        }
        found.negated = reader_.accept("-") || reader_.accept("!");
        const Token word = reader_.next();
        if (word.form == Token::mark || word.form == Token::end) throw SyntaxError(word.line, "an operand expected");
        found.form = word.form == Token::number ? Operand::number : Operand::name;
        found.text = word.text_;
        if (reader_.accept("+")) found.offset = static_cast<int64_t>(reader_.number());
        return found;
    }

    Operand address() {
        reader_.expect("[");
        Operand found;
        found.form = Operand::address;
        if (reader_.here().form == Token::name) found.text = reader_.next().text_;
        reader_.accept("+");
        const bool negative = reader_.accept("-");
        if (reader_.here().form == Token::number) {
            const auto offset = static_cast<int64_t>(reader_.number());
            found.offset = negative ? -offset : offset;
        }
        reader_.expect("]");
        return found;
    }

    // Bodies may end without a `ret`.
    void finish() {
        Statement s;
        s.line = reader_.here().line - (reader_.at_end() ? 1 : 0);
        s.opcode = "ret";
        Decoder decoder(*builder_, s);
        instructions().at("ret")(decoder);
    }

    Reader& reader_;
    Program& program_;
    const Scope& module_scope_;
    bool kernel_;
    Builder* builder_ = nullptr;
};

}  // namespace

void parse_function(Reader& reader, Program& program, const Scope& module_scope, bool kernel) {
    FunctionParser(reader, program, module_scope, kernel).run();
}

}  // namespace fake
