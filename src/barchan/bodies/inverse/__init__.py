"""Inverse statics with frictional contact: what bodies are like that are at rest as given (seed B, 4.4)."""
