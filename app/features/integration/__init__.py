"""The paper's integration, step by step."""
