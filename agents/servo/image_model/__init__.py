"""What is known of where points are seen: smooth functions of registers, from all looks in a trial."""
