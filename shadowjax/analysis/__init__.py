"""Analysis: tones, cost, metrics, and the ledger of equations with its runner."""
