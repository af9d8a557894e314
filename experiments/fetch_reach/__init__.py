"""FetchReach with a camera that is turned, and policies that know how its cameras were built."""
