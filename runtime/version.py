"""The version of Tendon, which pyproject.toml reads from here, and what is its own code."""

VERSION = "0.1.0"


def is_our_module(name: str) -> bool:
    """Whether a module of this full name is Tendon's."""
    # Installed from a wheel, the three packages are in the package tendon.
    return not {"runtime", "symbolic", "codegen"}.isdisjoint(name.split(".")[:2])


def is_ours(error: BaseException) -> bool:
    """Whether an error is of a class of Tendon, so that its message is for people."""
    return is_our_module(type(error).__module__)
