// PTX as words: names with their dots, numbers, strings and single characters.
#pragma once

#include <string>
#include <vector>

#include "instruction.hpp"

namespace fake {

struct Token {
    enum Form { name, number, text, mark, end } form;
    std::string text_;
    uint32_t line;

    bool is(const char* expected) const { return text_ == expected; }
};

std::vector<Token> tokens_of(const std::string& source);

}  // namespace fake
