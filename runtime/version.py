"""The version of Tendon, which pyproject.toml reads from here, and what is its own code."""

VERSION = "0.1.0"


def is_ours(error: BaseException) -> bool:
    """Whether an error is of a class of Tendon, so that its message is for people."""
    # Installed from a wheel, the three packages are in the package tendon.
    return not {"runtime", "symbolic", "codegen"}.isdisjoint(type(error).__module__.split(".")[:2])
