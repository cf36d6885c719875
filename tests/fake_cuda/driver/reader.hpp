// Walks along the words of a module; what declarations of all kinds have in common.
#pragma once

#include <algorithm>

#include "lexer.hpp"
#include "syntax.hpp"

namespace fake {

struct Declaration {
    Type type;
    std::string name;
    uint64_t align = 1;
    uint64_t bytes = 0;
    uint64_t copies = 0;  // of `%r<9>`: 9
    bool unsized = false;
    bool pointer = false;
};

class Reader {
   public:
    explicit Reader(const std::string& source) : tokens_(tokens_of(source)) {}

    const Token& here() const { return tokens_[at_]; }
    bool at_end() const { return here().form == Token::end; }
    bool at(const char* text) const { return here().is(text) && here().form != Token::text; }
    Token next() { return tokens_[at_ < tokens_.size() - 1 ? at_++ : at_]; }
    const Token& ahead() const { return tokens_[std::min(at_ + 1, tokens_.size() - 1)]; }
    [[noreturn]] void reject(const std::string& why) const { throw SyntaxError(here().line, why); }
    [[noreturn]] void reject_word() const { reject("'" + here().text_ + "' is not known here"); }

    bool accept(const char* text) {
        if (!at(text)) return false;
        next();
        return true;
    }

    void expect(const char* text) {
        if (!accept(text)) reject("'" + std::string(text) + "' expected, not '" + here().text_ + "'");
    }

    void skip_line() {
        const uint32_t line = here().line;
        while (!at_end() && here().line == line) next();
    }

    void skip_braces() {
        while (!at_end() && !at("{")) next();
        int depth = 0;
        do {
            if (at("{")) ++depth;
            if (at("}")) --depth;
            next();
        } while (depth && !at_end());
    }

    uint64_t number() {
        const Token token = next();
        return parse_number(token.text_, token.line);
    }

    // [.align N] [.vN] .type [.ptr ...] name [<N>] [[N]]...
    Declaration declaration() {
        Declaration d;
        uint64_t elements = 1;
        while (here().text_[0] == '.') {
            const Token word = next();
            if (word.is(".align")) d.align = number();
            else if (word.is(".v2")) elements = 2;
            else if (word.is(".v4")) elements = 4;
            else if (word.is(".ptr")) d.pointer = true;
            else if (d.pointer && (word.is(".global") || word.is(".const") || word.is(".shared"))) continue;
            else if (!parse_type(word.text_.substr(1), &d.type))
                throw SyntaxError(word.line, "'" + word.text_ + "' is not known here");
        }
        d.name = next().text_;
        d.bytes = elements * d.type.bytes;
        if (accept("<")) {
            d.copies = number();
            expect(">");
        }
        while (accept("[")) {
            if (at("]")) d.unsized = true;
            else d.bytes *= number();
            expect("]");
        }
        d.align = std::max<uint64_t>(d.align, std::max<uint64_t>(d.type.bytes, 1) * elements);
        return d;
    }

   private:
    std::vector<Token> tokens_;
    size_t at_ = 0;
};

using Scope = std::map<std::string, Symbol>;

// A static variable gets its place; a dynamic one begins where all of them do.
inline void add_shared(Program& program, const Declaration& d, std::vector<SharedVariable>& list, Scope& scope) {
    if (d.unsized) {
        scope[d.name] = {Symbol::shared, 0, kDynamicShared, 0};
        return;
    }
    constexpr uint32_t red_zone = 64;
    const auto start = static_cast<uint32_t>((program.shared_bytes + d.align - 1) / d.align * d.align);
    list.push_back({d.name, start, static_cast<uint32_t>(d.bytes)});
    scope[d.name] = {Symbol::shared, 0, start, d.bytes};
    program.shared_bytes = start + static_cast<uint32_t>(d.bytes) + red_zone;
    if (program.shared_bytes > kDynamicShared) throw SyntaxError(1, "too much static shared memory");
}

// Reads a function from its results or name to the end of its body.
void parse_function(Reader& reader, Program& program, const Scope& module_scope, bool kernel);

const DecodeTable& instructions();

}  // namespace fake
