-- Results of a kind of problems that are missing, in the order of the work: problems of experiments are sorted
-- by pair, so that a worker loads it once.
select p.task, p.dataset, p.pair, p.kind, p.other, p.nuisance, p.level, p.matches,
       p.nms_radius, p.front, p.voxel, p.size, p.repeats, p.seed, w.threads, w.entry, w.time_limit,
       w.epsilons, coalesce(r.epsilons, '[]'), w.solver
from wanted w join problems p on p.key = w.problem left join results r using (problem, solver, threads)
where w.task = ? and (
    r.problem is null
    -- Solvers that ran out of time are run again once the limit is raised.
    or r.skipped <> '' and r.time_limit < w.time_limit
    or exists (select value from json_each(w.epsilons) where value is not null
               except select value from json_each(r.epsilons)))
order by w.threads, case w.task when 'experiment' then 0 else w.entry end,
         case w.task when 'experiment' then p.dataset || ' ' || p.pair else '' end,
         w.place, w.problem, w.solver_place
