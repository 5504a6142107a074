"""The filter stage of the agent, and the bench that tries instruments."""
