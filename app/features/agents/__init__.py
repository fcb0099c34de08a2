"""`ispom mcp`: what a person sees in the page, as tools of the Model Context Protocol for agents."""
