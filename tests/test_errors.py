import re

from stereomend import errors


def all_errors():
    found = [errors.StereomendError]
    for error in found:
        found.extend(error.__subclasses__())
    return found


def test_the_tree_at_the_top_shows_every_error_in_its_place():
    tree = re.findall(r"^([|` ]*-? ?)(\w+)(?: \.+|  +)?.*$", errors.__doc__, re.MULTILINE)
    drawn = [(name, len(indent) // 3) for indent, name in tree if hasattr(errors, name)]
    depth = {
        error.__name__: len(error.__mro__) - len(errors.StereomendError.__mro__) for error in all_errors()
    }
    assert dict(drawn) == depth


def test_every_error_has_a_slug_of_its_own_and_says_when_it_is_raised():
    slugs = [error.slug for error in all_errors()]
    assert len(set(slugs)) == len(slugs)
    for error in all_errors()[1:]:
        assert error.__doc__.startswith("Raised when"), error
