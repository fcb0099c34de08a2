from typing import Annotated, Any

from ispom_app.features.agents.agent_session import AgentSession
from ispom_app.features.agents.tool import Tool

from .commands import Greet
from .state import Greetings


def greet(agents: AgentSession, times: Annotated[int, "How often."] = 1) -> dict[str, Any]:
    """Greets, and says how often that happened."""
    agents.carry_out(lambda controller: Greet(times).execute(controller))
    return {"count": agents.state[Greetings].count}


TOOLS = (Tool(greet, changes=True),)
