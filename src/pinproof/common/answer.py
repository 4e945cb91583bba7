"""Results that are a solution, or the reason why no solution exists or was found."""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar, overload

from pinproof.errors import NoAnswer

Own = TypeVar("Own", bound="Answer")
Value = TypeVar("Value")


class Answer:
    """A result that states whether it is a solution (``ok``), and the outcome as text (``message``)."""

    failure: ClassVar[type[NoAnswer]] = NoAnswer

    if TYPE_CHECKING:  # stated by the subclasses as fields or properties

        @property
        def ok(self) -> bool:
            """Whether it is a solution."""

        @property
        def message(self) -> str:
            """The outcome as text."""

    def or_raise(self: Own) -> Own:
        """Return the result itself if it is a solution (``.ok``).

        Raises
        ------
        NoAnswer
            Otherwise, with the message; ``.result`` of the error is this result. Results of inverse kinematics raise
            ``IkFailed`` and results of planning ``PlanFailed``, which are subclasses.
        """
        if not self.ok:
            raise self.failure(self.message, self)
        return self

    def changed(self: Own, **values: object) -> Own:
        """Return a copy with other values of fields; :func:`dataclasses.replace` would read those that are None."""
        other = copy(self)
        other.__dict__.update(values)
        return other


class Solution(Generic[Value]):
    """A field that an answer has if it is a solution; its constructor accepts None, which is the default.

    Reading the field where it is None raises the exception of :meth:`Answer.or_raise`. Its type is therefore without
    None, also where a type checker does not know that the result is a solution.
    """

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, result: None, owner: type) -> Any: ...
    @overload
    def __get__(self, result: Answer, owner: type | None = None) -> Value: ...
    def __get__(self, result: Answer | None, owner: type | None = None) -> Any:
        if result is None:  # read from the class: the default of the field
            return None
        value = result.__dict__[self._name]
        if value is None:
            raise result.failure(result.message if not result.ok else f"this result has no {self._name}", result)
        return value

    def __set__(self, result: Answer, value: Value | None) -> None:
        result.__dict__[self._name] = value
