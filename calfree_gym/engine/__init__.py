"""N arms stepped together, whatever their task: the engine of the single and the batched environments."""
