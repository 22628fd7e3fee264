"""The texts of reports, from the templates of the resources."""

from collections.abc import Mapping
from functools import cache
from importlib.resources import files

from jinja2 import Environment, StrictUndefined, Template

__all__ = ["block_text", "caption", "template_text"]


@cache
def _template(name: str) -> Template:
    environment = Environment(
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    return environment.from_string((files("homolog_resources") / name).read_text(encoding="utf-8"))


def template_text(name: str, context: Mapping[str, object]) -> str:
    """Return the text that a template gives; a name that it lacks is an error."""
    return _template(name).render(context)


def block_text(name: str, block: str, /, **values: object) -> str:
    """Return the text of a block of a template."""
    template = _template(name)
    return "".join(template.blocks[block](template.new_context(values))).strip()


def caption(block: str, /, **values: object) -> str:
    """Return the caption of a figure."""
    return block_text("captions.jinja", block, **values)
