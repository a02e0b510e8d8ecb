from kinetic_solver.cli import main

main()
