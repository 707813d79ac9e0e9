// What the robot's web server says of the status, of commands and of pairing, in Czech. Its sentences are English and not
// numbered: each is here as it begins in its source, and a test looks it up there. Others stay as they are.
import { commander, place } from "./holds";

type Turn = (found: string[], said: (part: string) => string) => string;

/** Names of states of modules, of processes and of sources stay as they are. */
export const SENTENCES: readonly (readonly [RegExp, string | Turn])[] = [
  // The status (foundation/diagnostics/src/status.rs).
  [/^no message from a robot was received; is it on\?$/, "z robota nepřišla žádná zpráva; je zapnutý?"],
  [/^no message from the robot for (\d+) s$/, ([s]) => `z robota nic nepřišlo už ${s} s`],
  [/^the PAUSE line is engaged by (.*); release it, then resume$/, ([by], said) => `je aktivní PAUSE: ${said(by ?? "")}; uvolněte jej, pak zvolte Pokračovat`],
  [/^simulation paused$/, "simulace stojí"],
  [/^driver_canbus does not report the drives$/, "modul driver_canbus nehlásí stav pohonů"],
  [/^the robot is stopping: (.*)$/, ([why], said) => `robot zastavuje: ${said(why ?? "")}`],
  [/^the drives are not ready$/, "pohony nejsou připraveny"],
  [/^the robot is at standstill without a command$/, "robot stojí a nemá žádný povel"],
  [/^the robot is at standstill(?:; commanded by (.*))?$/, ([by]) => (by ? `robot stojí; povely: ${commander(by)}` : "robot stojí")],
  [/^(-?[\d.]+) m\/s(?:; commanded by (.*))?$/, ([speed, by]) => `${decimal(speed)} m/s${by ? `; řídí ${commander(by)}` : ""}`],
  [/^(\S+) is (running|ending|down|not judged)(?:: (.*))?; the robot does not move without it$/, ([module, phase, why], said) => `modul ${module} – ${said(phase ?? "")}${why ? ` (${said(why)})` : ""}; bez něj robot nejede`],

  // What is not well (foundation/diagnostics/src/concerns.rs).
  [/^simulation at ([\d.]+) ×$/, ([rate]) => `simulace v rychlosti ${decimal(rate)} ×`],
  [/^position not known$/, "poloha není známa"],
  [/^position lost$/, "poloha ztracena"],
  [/^range finders not known$/, "dálkoměry: není známo"],
  [/^(\d+) of (\d+) range finders do not measure$/, ([n, of]) => `neměří ${n} z ${of} dálkoměrů`],
  [/^(\S+) does not run$/, ([module]) => `modul ${module} neběží`],
  [/^(\S+) is in (INIT|RUN|PAUSE|STOP|ERROR|TERMINATE)$/, ([module, state]) => `modul ${module} je ve stavu ${state}`],
  [/^battery (\d+) %$/, ([percent]) => `baterie ${percent} %`],

  // The bound of the guard (foundation/diagnostics/src/guard.rs).
  [/^creeping; otherwise (.*)$/, ([rest], said) => `popojíždí; jinak ${said(rest ?? "")}`],
  [/^turns on the spot at (\d+) deg\/s(?:; commanded by (.*))?$/, ([turn, by]) => `otáčí se na místě, ${turn}°/s${by ? `; řídí ${commander(by)}` : ""}`],
  [/^at most ([\d.]+) m\/s (forward|backward)(?:: (.*))?$/, ([speed, way, why], said) => `nejvýše ${decimal(speed)} m/s ${WAYS[way ?? ""]}${why ? `: ${said(why)}` : ""}`],
  [/^must not move (forward|backward)(?:: (.*))?$/, ([way, why], said) => `nesmí se pohnout ${WAYS[way ?? ""]}${why ? `: ${said(why)}` : ""}`],
  [/^nothing is known of (.*): its space counts as occupied$/, ([what]) => `snímač ${what} nic neposílá: jeho prostor platí za obsazený`],
  [/^nothing is known of the sonars at the (front|rear)$/, ([side]) => `o sonarech ${SIDES[side ?? ""]} není nic známo`],
  [/^nothing is known of (.*)$/, ([what]) => `snímač ${what} nic neposílá`],
  [/^no sensor looks there$/, "tím směrem se nedívá žádný snímač"],
  [/^the guard does not report$/, "hlídač okolí neodpovídá"],
  [/^the guard does not know the motion$/, "hlídač okolí nezná pohyb robota"],
  [/^the guard permits no more this way$/, "hlídač okolí tímto směrem víc nedovolí"],
  [/^the sensors reach no farther: .*$/, "dál snímače nedosáhnou"],
  [/^something is near: (.*)$/, ([what]) => `v blízkosti něco je: ${what}`],
  [/^the robot slows for what is ahead: (.*)$/, ([what]) => `robot zpomaluje před tím, co je vpředu: ${what}`],
  [/^nothing senses what is in the way: .*$/, "překážky v cestě nehlídá žádný snímač: robot jede pomalu"],
  [/^nobody commands the motion$/, "nikdo nezadává pohyb"],

  // The goal (modules/planner/src/goal_state.rs).
  [/^there is no goal$/, "není zadán cíl"],
  [/^cancelled: there is no goal$/, "cíl zrušen"],
  [/^goal \d+ refused: (.*)$/, ([why], said) => said(why ?? "")],
  [/^(.*); the robot goes on to the goal before it$/, ([why], said) => `${said(why ?? "")}; robot jede dál k předchozímu cíli`],
  [/^refused: (.*)$/, ([why], said) => `cíl odmítnut: ${said(why ?? "")}`],
  [/^looks for a way$/, "hledá cestu"],
  [/^drives to waypoint (\d+) of (\d+)(, for ever)?(, slowly: the way is narrow)?$/, ([at, of, loops, slowly]) => `jede k bodu ${at} z ${of}${loops ? ", stále dokola" : ""}${slowly ? ", pomalu: cesta je úzká" : ""}`],
  [/^waits for whoever stands in the way at (.*)$/, ([at]) => `čeká: v cestě někdo stojí, místo ${place(at ?? "")}`],
  [/^waits for whoever stands near$/, "čeká: někdo stojí příliš blízko"],
  [/^waits for a way to waypoint (\d+): (.*)$/, ([to, why], said) => `čeká na cestu k bodu ${to}: ${said(why ?? "")}`],
  [/^waits: (.*)$/, ([why], said) => `čeká: ${said(why ?? "")}`],
  [/^backs out$/, "couvá"],
  [/^mode manual: only people drive the robot$/, "režim ručně: robota řídí jen lidé"],
  [/^no home place is configured$/, "není nastaveno domovské místo"],
  [/^waits for people$/, "čeká na lidi"],
  [/^stands before a person$/, "stojí před člověkem"],
  [/^drives to a person at (.*)$/, ([at]) => `jede k člověku, místo ${place(at ?? "")}`],
  [/^turns to a person$/, "otáčí se k člověku"],
  [/^finds no way to the person: tries again soon$/, "nenachází cestu k člověku: za chvíli to zkusí znovu"],
  [/^reached waypoint (\d+), the last$/, ([to]) => `je v posledním bodě (${to})`],
  [/^stands at the only waypoint of its loop$/, "stojí v jediném bodě své smyčky"],
  [/^cannot reach waypoint (\d+): (.*)$/, ([to, why], said) => `k bodu ${to} nedojede: ${said(why ?? "")}`],
  [/^gave up waypoint (\d+): (.*)$/, ([to, why], said) => `vzdal cestu k bodu ${to}: ${said(why ?? "")}`],
  [/^the robot does not fit in at the goal$/, "robot se v cíli nevejde"],
  [/^the robot stands in an obstacle or outside of the map$/, "robot stojí v překážce nebo mimo mapu"],
  [/^no way leads to the goal$/, "k cíli nevede žádná cesta"],
  [/^no way was found with the work allowed$/, "v povoleném čase se cesta nenašla"],
  [/^a coordinate is no number$/, "souřadnice není číslo"],
  [/^it is outside the map, which is (.*)…(.*) by (.*)…(.*) m$/, ([x, right, y, top]) => `leží mimo mapu (${decimal(x)} až ${decimal(right)} krát ${decimal(y)} až ${decimal(top)} m)`],
  [/^the floor between is too large$/, "je příliš daleko"],
  [/^it was commanded to drive and does not move$/, "měl jet a nejede"],
  [/^the robot came to stand ([\d.]+) m beside it$/, ([off]) => `robot zastavil ${decimal(off)} m vedle něj`],
  [/^something stands in the way$/, "něco stojí v cestě"],

  // Modules and their processes (foundation/diagnostics/src/modules.rs).
  [/^running$/, "běží"],
  [/^ending$/, "končí"],
  [/^down$/, "neběží"],
  [/^not judged$/, "neposuzuje se"],
  [/^ended on command$/, "ukončen na povel"],
  [/^ended unseen$/, "skončil nepozorovaně"],
  [/^a resource is unavailable \((0x\w+)\)(?:: (.*))?$/, ([code, why], said) => `chybí prostředek (${code})${why ? `: ${said(why)}` : ""}`],
  [/^a device failed \((0x\w+)\)(?:: (.*))?$/, ([code, why], said) => `selhalo zařízení (${code})${why ? `: ${said(why)}` : ""}`],
  [/^failed \((0x\w+)\)(?:: (.*))?$/, ([code, why], said) => `selhal (${code})${why ? `: ${said(why)}` : ""}`],
  [/^(SIG[A-Z]+): (crashed|aborted|killed|hung|terminated)$/, ([signal, how]) => `${signal}: ${ENDS[how ?? ""]}`],
  [/^ended with (-?\d+)$/, ([code]) => `skončil s kódem ${code}`],
  // Why it ended (foundation/module/src/exit.rs).
  [/^the machine refused what it needs to start$/, "systém odmítl to, co potřebuje ke spuštění"],
  [/^its place in the shared memory of the message bus was damaged$/, "jeho místo ve sdílené paměti sběrnice zpráv bylo poškozeno"],
  [/^the kernel refused to wait for input$/, "jádro odmítlo čekat na vstup"],
  [/^its server stood still$/, "jeho server se zastavil"],
  [/^another program has its address$/, "jeho adresu má jiný program"],
  [/^a defect of the program, at the place in its last line$/, "chyba programu; místo je na posledním řádku výpisu"],

  // Who holds the motion authority (modules/web/src/center/authority.rs, operator.rs).
  [/^(.*) has gone: nobody holds the robot$/, ([name]) => `zařízení ${name} se odpojilo: řízení nemá nikdo`],
  [/^(.*) holds the robot now: look again, then take over$/, ([name]) => `řízení má nyní ${name}: podívejte se znovu, pak převezměte`],
  [/^(.*) has taken over from you$/, ([name]) => `řízení od vás převzalo zařízení ${name}`],
  [/^you have taken over$/, "převzali jste řízení"],
  [/^(.*) has taken over$/, ([name]) => `řízení převzalo zařízení ${name}`],
  [/^the robot is yours$/, "řízení máte vy"],
  [/^(.*) holds the robot: take over first$/, ([name]) => `řízení má ${name}: nejprve je převezměte`],
  [/^(.*) holds the robot$/, ([name]) => `řízení má ${name}`],
  [/^the robot is not yours: take it first$/, "nemáte řízení: nejprve je převezměte"],
  [/^the robot is not yours$/, "nemáte řízení"],
  [/^you have released the robot$/, "uvolnili jste řízení"],
  [/^(.*) has released the robot$/, ([name]) => `řízení uvolnilo zařízení ${name}`],
  [/^take control of the robot first$/, "nejprve převezměte řízení"],
  [/^(.*) has stopped the robot$/, ([name]) => `robota zastavilo zařízení ${name}`],
  [/^what was heard came too late: press anew$/, "povely přišly pozdě: stiskněte znovu"],
  [/^what was heard came too late$/, "povely přišly pozdě"],
  [/^this hold is over: press anew$/, "stisk už neplatí: stiskněte znovu"],
  [/^nothing was heard for 0\.2 s$/, "0,2 s nepřišel žádný povel"],
  [/^what this page says is not understood$/, "robot povelům této stránky nerozumí"],
  [/^this is for engineers: pair with their code from the robot's console$/, "to smí jen technik: spárujte se jeho kódem z konzole robota"],
  [/^this is for operators: pair with the code from the robot's console$/, "to smí jen obsluha: spárujte se kódem z konzole robota"],
  [/^this device is not paired any more$/, "zařízení už není spárované"],
  [/^a recorded run is played: nothing can be commanded$/, "přehrává se záznam: povely nelze zadávat"],
  [/^this robot is not simulated$/, "tento robot není simulovaný"],
  [/^a waypoint is out of range$/, "bod trasy je mimo rozsah"],
  [/^a place out of range$/, "místo je mimo rozsah"],
  [/^a value out of range$/, "hodnota je mimo rozsah"],

  // Pairing, runs, the connection (modules/web/src).
  [/^a name has 1 to 40 characters$/, "jméno má 1 až 40 znaků"],
  [/^this is not a code that pairs now: `advee web code` on the robot's computer shows one$/, "tento kód teď neplatí: nový vypíše „advee web code“ na počítači robota"],
  [/^too many have tried: wait a minute$/, "příliš mnoho pokusů: počkejte minutu"],
  [/^this device is not paired$/, "zařízení není spárované"],
  [/^no such device is paired$/, "takové zařízení spárované není"],
  [/^the robot answered (\d+)$/, ([code]) => `robot odpověděl chybou ${code}`],
  [/^the robot's web server ends$/, "webový server robota se ukončuje"],
  [/^nothing was heard for 10 s$/, "10 s nic nepřišlo"],
  [/^there is no recorded run to play$/, "není žádný záznam k přehrání"],
  [/^there is no recorded run of that name$/, "záznam tohoto jména neexistuje"],
  [/^as many recorded runs are played as may be at once$/, "víc záznamů najednou přehrávat nelze"],
  [/^the run (\S+) has no messages$/, ([run]) => `záznam ${run} neobsahuje žádné zprávy`],
  [/^there is no such run; \/api\/logs has all$/, "takový záznam neexistuje"],
  [/^the run cannot be read on.*$/, "záznam nelze dál číst"],
  [/^the run cannot be read(?:: (.*))?$/, ([why]) => `záznam nelze přečíst${why ? `: ${why}` : ""}`],
  [/^the run is longer than (\d+) GiB; advee plot draws it$/, ([n]) => `záznam je delší než ${n} GiB; vykreslí ho advee plot`],

  // What happened in a run (modules/web/src/center/events.rs), and sources of the PAUSE line.
  [/^PAUSE: (.*)$/, ([by], said) => `PAUSE: ${said(by ?? "")}`],
  [/^an operator stopped the robot$/, "obsluha zastavila robota"],
  [/^the robot touched something$/, "robot se něčeho dotkl"],
  [/^bumper ?(\d)$/, ([n]) => `nárazník ${n}`],
  [/^sd1_front$/, "přední snímače podlahy"],
  [/^sd1_rear$/, "zadní snímače podlahy"],
  [/^button$/, "červené tlačítko"],
  [/^the front floor sensors$/, "přední snímače podlahy"],
  [/^the rear floor sensors$/, "zadní snímače podlahy"],
  [/^the red button$/, "červené tlačítko"],
  [/^an unknown source$/, "neznámý zdroj"],

  // Who commands the motion (messages/src/source.rs).
  [/^planner$/, "plánovač"],
  [/^a terminal \(advee diag\)$/, "terminál (advee diag)"],
  [/^advee ([a-z]+)(?: on (.+))?$/, (found) => commander(`advee ${found[0]}${found[1] ? ` on ${found[1]}` : ""}`)],

  // After a cause.
  [/^, error code (0x[0-9a-fA-F]+)$/, ([code]) => `, kód chyby ${code}`],
];

const WAYS: Readonly<Record<string, string>> = { forward: "vpřed", backward: "vzad" };
const SIDES: Readonly<Record<string, string>> = { front: "vpředu", rear: "vzadu" };
const ENDS: Readonly<Record<string, string>> = { crashed: "havaroval", aborted: "přerušil se", killed: "násilně ukončen", hung: "uvázl", terminated: "ukončen" };

const decimal = (text: string | undefined): string => (text ?? "").replace(".", ",");

export function robot(text: string, said: (part: string) => string): string | null {
  for (const [pattern, words] of SENTENCES) {
    const found = pattern.exec(text);
    if (found) return typeof words === "string" ? words : words(found.slice(1), said);
  }
  return null;
}
