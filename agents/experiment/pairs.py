"""Settings as words of a command line, KEY:VALUE; each value is that of Python, or else that of YAML 1.2."""

import ast
import re
from typing import Annotated, Any

import tyro

# What is no string without quotes.
SCALARS = {
    "null": "null|Null|NULL|~",
    "bool": "true|True|TRUE|false|False|FALSE",
    "int": "[-+]?(?:0|[1-9][0-9]*)",
    "float": r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?",
}


def pairs_from(words: list[str]) -> dict[str, Any]:
    """{"alpha": 4.0, "rotor_limits": True} from ["alpha:4.0", "rotor_limits:true"].

    Raises:
        ValueError: for a word without a key or a value, a value that is no YAML, and a key given twice.
    """
    table: dict[str, Any] = {}
    for word in words:
        key, colon, value = word.partition(":")
        if not (key and colon and value):
            raise ValueError(f"{word!r} must be KEY:VALUE")
        if key in table:
            raise ValueError(f"{key} must be given once, got {word!r} after {table[key]!r}")
        table[key] = _value(key, value)
    return table


def _value(key: str, text: str) -> Any:
    # 3e-4 and None are none of YAML's, and what --help shows is Python's.
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return _yaml_value(key, text)


def _yaml_value(key: str, text: str) -> Any:
    import yaml

    class Loader(yaml.SafeLoader):
        # To YAML 1.1, which PyYAML reads, off is a truth value and 1:30 a number.
        yaml_implicit_resolvers = {}  # noqa: RUF012 - PyYAML's attribute

    for tag, pattern in SCALARS.items():
        Loader.add_implicit_resolver(f"tag:yaml.org,2002:{tag}", re.compile(f"^(?:{pattern})$"), None)
    try:
        return yaml.load(text, Loader)
    except yaml.YAMLError as error:
        raise ValueError(f"{key} must have a value in YAML, got {text!r}") from error


def _words(table: dict[str, Any]) -> list[str]:
    return [f"{key}:{value}" for key, value in table.items()]


Pairs = Annotated[
    dict[str, Any],
    tyro.constructors.PrimitiveConstructorSpec(
        nargs="*",
        metavar="[KEY:VALUE ...]",
        instance_from_str=pairs_from,
        is_instance=lambda instance: isinstance(instance, dict),
        str_from_instance=_words,
    ),
]
