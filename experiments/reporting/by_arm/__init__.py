"""One suite, many arms: how soon each agent reaches with each of them."""
