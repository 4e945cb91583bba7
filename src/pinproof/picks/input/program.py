"""What a picks file states about the programs of a robot controller: tool, frame, sensor and external axes."""

from __future__ import annotations

from pinproof.common import structs as st

ERROR_OF_INPUT = st.Rule(
    ("error",),
    lambda own: "state the input whose absence calls it" if own.error is not None and own.input is None else "",
    {"dependentRequired": {"error": ["input"]}},
)


@st.struct("program_settings", eq=False, rules=[ERROR_OF_INPUT])
class ProgramSettings:
    """What programs of a robot controller state beside the moves."""

    tool: str = st.key("name of the tool", default="tool")
    flange: str | None = st.key(
        "the link that is the flange of the controller, in whose frame its tool is stated; by default `tool0` or "
        "`flange`, if the last joint moves it, or else the link of the last joint",
        default=None,
    )
    frame: str | None = st.key("one of `frames`, as the work object or user frame; by default none", default=None)
    output: str | None = st.key(
        "the digital output that closes the gripper; by default that of the language", default=None
    )
    input: str | None = st.key(
        "a digital input that is on while the hand holds a part. It is checked after each grip; by default none",
        default=None,
    )
    timeout: float = st.key("how long a program waits for the input, after which it ends", "s", default=1.0, above=0)
    error: str | None = st.key(
        "a routine of the controller that is called before a program ends because the input is off; by default none",
        default=None,
    )
    home: bool = st.key(
        "whether a program returns to home after the part is put down, if a return is proven", default=True
    )
    main: bool = st.key("whether a routine `main` that calls the programs in order is written too", default=False)
    external_axes: tuple[str, ...] | None = st.key(
        "the joints that the controller moves as external axes; by default the prismatic joints before the last six",
        default=None,
        kind=st.list_of(st.TEXT),
        shown=None,
    )
