"""Lines of LLVM's language, with names for values and blocks.

All names that are made here have a dot in them; names of the program have none.
"""

from collections.abc import Callable

LARGEST_UNROLLED = 64
"""Passes of a simple loop that is written out."""


class Text:
    """A function's body while it is written."""

    def __init__(self) -> None:
        self._lines = [".entry:"]
        self._count = 0
        self._block = ".entry"

    def add(self, line: str) -> None:
        """Write an instruction that has no value, or a named one."""
        self._lines.append(f"  {line}")

    def new(self, instruction: str) -> str:
        """Write an instruction and return the name of its value."""
        self._count += 1
        self.add(f"%.{self._count} = {instruction}")
        return f"%.{self._count}"

    def address(self, kind: str, base: str, index: int | str) -> str:
        """Return the address of element `index` of an array."""
        return self.new(f"getelementptr inbounds {kind}, ptr {base}, i64 {index}")

    def pointer(self, table: str, index: int) -> str:
        """Load a pointer from a table of pointers."""
        return self.new(f"load ptr, ptr {self.address('ptr', table, index)}, align 8")

    def each(
        self, n: int, body: Callable[[int | str], None], *, unrolled: int = LARGEST_UNROLLED
    ) -> None:
        """Write a body for k = 0 ... n - 1: one after the other or, if n is large, as a loop.

        The body is given the number, or the name of the counter.
        """
        if n > unrolled:
            counter = self._label("each")
            self.repeat(counter, str(n), lambda: body(counter))
        else:
            for k in range(n):
                body(k)

    def repeat(self, counter: str, length: str, body: Callable[[], None]) -> None:
        """Write ``for counter in range(length)``; there is at least one pass."""
        before, head, after = self._block, self._label(counter), self._label("after")
        latch = self._label("next")
        self._start(head)
        self.add(f"%{counter} = phi i64 [ 0, %{before} ], [ %{counter}.more, %{latch} ]")
        body()
        self._start(latch)
        self.add(f"%{counter}.more = add nuw nsw i64 %{counter}, 1")
        more = self.new(f"icmp ult i64 %{counter}.more, {length}")
        self._branch(more, head, after)

    def repeat_while(self, limit: int, test: Callable[[], str], body: Callable[[], None]) -> None:
        """Write a loop that ends after `limit` passes, or earlier when the test fails."""
        before, head, inside = self._block, self._label("while"), self._label("pass")
        latch, after = self._label("next"), self._label("after")
        self._start(head)
        self.add(f"%{head}.count = phi i64 [ 0, %{before} ], [ %{head}.more, %{latch} ]")
        left = self.new(f"icmp ult i64 %{head}.count, {limit}")
        go = self.new(f"and i1 {left}, {test()}")
        self._branch(go, inside, after, following=inside)
        body()
        self._start(latch)
        self.add(f"%{head}.more = add nuw nsw i64 %{head}.count, 1")
        self.add(f"br label %{head}")
        self._open(after)

    def mended(self, good: str, kind: str, value: str, mend: Callable[[], str]) -> str:
        """Return the value, or, where the condition `good` fails, what is written to mend it."""
        before, wrong, after = self._block, self._label("wrong"), self._label("after")
        self._branch(good, after, wrong, following=wrong)
        other = mend()
        wrong = self._block
        self._start(after)
        return self.new(f"phi {kind} [ {value}, %{before} ], [ {other}, %{wrong} ]")

    def function(self, head: str, result: str = "void") -> str:
        """Return the whole function; the result is its type and value."""
        return "\n".join([f"{head} {{", *self._lines, f"  ret {result}", "}"])

    def _label(self, wish: str) -> str:
        self._count += 1
        return f".{wish}.{self._count}"

    def _branch(self, condition: str, yes: str, no: str, following: str | None = None) -> None:
        self.add(f"br i1 {condition}, label %{yes}, label %{no}")
        self._open(following or no)

    def _start(self, label: str) -> None:
        self.add(f"br label %{label}")
        self._open(label)

    def _open(self, label: str) -> None:
        self._lines.append(f"{label}:")
        self._block = label
