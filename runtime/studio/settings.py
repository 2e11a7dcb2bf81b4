"""Every limit of the studio, with its unit, its reason and its source."""

from __future__ import annotations

from typing import Final

MOST_UPLOADED: Final = 2_000_000_000
"""bytes of one file that a browser sends; as many as a recording may have on the command line."""

MOST_MODEL: Final = 10_000_000
"""bytes of a model file, URDF or plan that a browser sends; the largest URDFs of arms have some 100 kB; a choice."""

MOST_REQUEST: Final = 1_000_000
"""bytes of any other request and of a message of a page's socket: clicks and texts have some 100; a choice."""

MOST_SETS: Final = 24
"""number of signal sets that are kept in memory, with their pyramids: three steps of seven joints; a choice."""

MOST_DOCUMENTS: Final = 200
"""number of documents of a session that are kept in memory: those of some thirty steps; a choice."""

MOST_NAME: Final = 100
"""bytes of a file's name in the session folder: file systems take 255; a choice."""

MOST_RECORDINGS: Final = 100
"""number of recordings in a session; a choice."""

MOST_SESSION: Final = 50_000_000
"""bytes of a document of a session, which is read whole: an arm in motion has some 500 000; a choice."""

ENDS_WITHIN: Final = 0.5
"""s between asking a process to end and ending it; cancelling is to take less than one; a choice."""

PROGRESS_EVERY: Final = 0.1
"""s between two messages about the progress of the same part of a task: a page does not show more; a choice."""

TOKEN_BYTES: Final = 32
"""number of random bytes in the address: nobody guesses 256 bits; NIST SP 800-63B asks for 64."""

MOST_PLANS: Final = 100
"""number of plans in a session; a choice."""

MOST_UNDONE: Final = 100
"""number of changes of the inputs that can be undone; a choice."""

LOOKS_EVERY: Final = 0.05
"""s between two looks at whether the task has ended for which a file that was sent waits; a person sees no delay."""

MOST_CURES: Final = 3
"""number of times that a recording is read to guess its columns: position, rate and torque of a joint may be wrong; a
choice."""
