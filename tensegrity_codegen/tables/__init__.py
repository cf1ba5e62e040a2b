"""What is registered: laws, quantities, formulations, tableaus, targets; request and manifest."""
