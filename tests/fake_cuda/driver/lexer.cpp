#include "lexer.hpp"

#include <cctype>

namespace fake {
namespace {

bool in_name(char c) {
    return std::isalnum(static_cast<unsigned char>(c)) || c == '_' || c == '$' || c == '%' || c == '.';
}

class Lexer {
   public:
    explicit Lexer(const std::string& source) : source_(source) {}

    std::vector<Token> run() {
        while (skip_blanks()) take();
        tokens_.push_back({Token::end, "", line_});
        return std::move(tokens_);
    }

   private:
    char at(size_t ahead = 0) const { return here_ + ahead < source_.size() ? source_[here_ + ahead] : '\0'; }

    void step() {
        if (at() == '\n') ++line_;
        ++here_;
    }

    bool skip_blanks() {
        while (here_ < source_.size()) {
            if (at() == '/' && at(1) == '/') {
                while (here_ < source_.size() && at() != '\n') step();
            } else if (at() == '/' && at(1) == '*') {
                skip_comment();
            } else if (std::isspace(static_cast<unsigned char>(at())) || at() == '\0') {
                step();
            } else {
                return true;
            }
        }
        return false;
    }

    void skip_comment() {
        while (here_ < source_.size() && !(at() == '*' && at(1) == '/')) step();
        here_ += 2;
    }

    void take() {
        const size_t start = here_;
        if (at() == '"') {
            step();
            while (here_ < source_.size() && at() != '"') step();
            step();
            tokens_.push_back({Token::text, source_.substr(start + 1, here_ - start - 2), line_});
        } else if (in_name(at())) {
            const bool digit = std::isdigit(static_cast<unsigned char>(at())) != 0;
            while (in_name(at())) step();
            tokens_.push_back({digit ? Token::number : Token::name, source_.substr(start, here_ - start), line_});
        } else {
            step();
            tokens_.push_back({Token::mark, source_.substr(start, 1), line_});
        }
    }

    const std::string& source_;
    size_t here_ = 0;
    uint32_t line_ = 1;
    std::vector<Token> tokens_;
};

}  // namespace

std::vector<Token> tokens_of(const std::string& source) { return Lexer(source).run(); }

}  // namespace fake
