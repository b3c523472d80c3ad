"""Words about a snapshot: plain text without markup."""
