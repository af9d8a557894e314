"""The agent `in_context`: a trained network that remembers its trials."""

from ...base.observation import RawObservation
from ...base.storage import AgentFile
from .network import RecurrentState, save_network
from .recurrent_servo import RecurrentServo


class InContext(RecurrentServo):
    """The network of `recurrent_servo` with a memory that outlasts trials, trained over thousands of lives.

    Each life was of many trials in one world, whose cameras were sometimes changed on the way; so it learned
    what to keep of a trial for the next ones (RL²; Duan et al. 2016). Its weights are frozen: what `learn`
    changes is its memory. `predict` begins each trial with this memory, and does not change it.

    The weights kept with the code began as those of `recurrent_servo` (64 CPU minutes), and learned on one
    H200 for six minutes, 2,633 updates, from 8,192 robots in as many worlds.

    Args:
        env: The environment; observations and words must have the shapes of the training, so three motors.
        seed: Of no effect: nothing is drawn.
        weights: File of another network than the one kept with the code.

    Raises:
        ValueError: The environment has another observation format than the network.
    """

    kind = "in_context"

    def save(self, path: AgentFile) -> None:
        """See `Agent`. What `recurrent_servo` saves, and what is remembered."""
        save_network(path, self._network, self._shapes, self.training, self.num_timesteps, self._life)

    def _at_beginning(self, robots: int) -> RecurrentState:
        return RecurrentState(*(part.repeat(robots, *[1] * (part.ndim - 1)) for part in self._life))

    def _made_a_motion(self, observation: RawObservation, state: RecurrentState, over: bool) -> None:
        """Remembers what was seen, at the end of a trial that too with which it ended."""
        if over:
            _, state = self.predict(observation, state)
        self._life = self._network.begin_trial(state)
