from kinetic_solver.cli.app import main

main()
