"""One run whose FLSs live on many hosts (docs/cluster.md)."""
