"""Let the reference show functions and classes that are made from declared options as they are at run time."""

import inspect
from importlib import import_module
from typing import Any

import griffe


class DeclaredOptions(griffe.Extension):
    """Replace parameters and docstrings, which are not in the source."""

    def on_function(self, *, func: griffe.Function, **_: Any) -> None:
        """Give a function of options its signature and docstring."""
        decorators = " ".join(str(one.value) for one in func.decorators)
        is_function = "function_of" in decorators or "use_case_of" in decorators
        if is_function or "of_options" in decorators:
            made = getattr(import_module(func.module.path), func.name)
            func.docstring = griffe.Docstring(inspect.getdoc(made) or "", parent=func)
            if is_function:
                func.parameters = _parameters(made)

    def on_class(self, *, cls: griffe.Class, **_: Any) -> None:
        """Give a class of options its signature and docstring."""
        made = getattr(import_module(cls.module.path), cls.name) if "options" in cls.module.path else None
        if made and hasattr(made, "__dataclass_fields__"):
            cls.docstring = griffe.Docstring(inspect.getdoc(made) or "", parent=cls)
            cls.set_member("__init__", griffe.Function("__init__", parameters=_parameters(made)))


def _parameters(made: Any) -> griffe.Parameters:
    shown = [
        griffe.Parameter(
            one.name,
            annotation=str(one.annotation),
            kind=griffe.ParameterKind[one.kind.name.lower()],
            default=None if one.default is one.empty else repr(one.default),
        )
        for one in inspect.signature(made).parameters.values()
    ]
    return griffe.Parameters(*shown)
