"""One motion to where the object is: the ceiling of every comparison."""

from __future__ import annotations

from ..base.observation import Observation
from ..base.procedure import Procedure, ProcedureAgent
from ..base.registration import agent


@agent("oracle", "Is told where to go: the ceiling.")
class Oracle(ProcedureAgent):
    """Sends the words that bring the gripper to the object, which it is told.

    It knows the world: its observations have a privileged key, the registers at which the gripper is at the
    object. So it shows what is left to noise, to end stops, and to the one motion that a reach takes. After
    its first motion it goes on by the same rule, which is of use where the world changes in mid-trial.
    """

    privileged = ("object_registers",)
    needs_points = False

    @property
    def kind(self) -> str:
        """See `ProcedureAgent`."""
        return "Oracle()"

    def procedure(self, first: Observation, findings: None) -> Procedure:
        """See `ProcedureAgent`."""
        now = first
        while True:
            now = yield now.privileged["object_registers"] - now.registers
