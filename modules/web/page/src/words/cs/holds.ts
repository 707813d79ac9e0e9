// Czech sentences of the causes for which the robot does not act (docs/holds.md), and what to do. `{}` is the subject as
// people call it, in the nominative: no sentence declines it, and none has a verb that depends on its gender.
import type { HOLD } from "../../numbers";
import type { HoldRow } from "../../protocol";

type Code = (typeof HOLD)[keyof typeof HOLD];

const WAIT = "Počkejte několik sekund.";
const AFTER_ERRORS = "Podívejte se na chyby: {}.";
const FREE_THE_WAY = "Uvolněte průjezd.";

export const HOLDS: Readonly<Record<Code, readonly [words: string, remedy: string]>> = {
  101: ["stav signálu PAUSE není znám", "Zkontrolujte, že je řídicí jednotka napájení zapnutá a připojená."],
  102: ["byl aktivní PAUSE: robot čeká na obsluhu", "Odstraňte příčinu; pak uvolněte ovládání a stiskněte je znovu, nebo znovu odešlete cíl."],
  103: ["pole, která hlídá {}, nejsou známa", "Podívejte se na chyby a na moduly: driver_lidar musí běžet. Pak uvolněte ovládání a stiskněte je znovu."],
  104: ["stav vstupu není znám: {}", "Zkontrolujte napájení a kabel zařízení, které vstup čte, chyby a moduly. Pak uvolněte ovládání a stiskněte je znovu."],
  111: ["je aktivní PAUSE: {}", "Odstraňte, čeho se dotýká {}."],
  112: ["je aktivní PAUSE: {}", "Odtlačte robota rukou zpět, až budou {} nad rovnou podlahou."],
  113: ["je aktivní PAUSE: {}", "Pootočte červeným tlačítkem, dokud nevyskočí."],
  114: ["je aktivní PAUSE: {}, vlastní pole", "Uvolněte pole, která hlídá {}; není-li v nich nic, podívejte se na chyby."],
  115: ["je aktivní PAUSE: {}", "Uvolněte nouzové zastavení: {}. Není-li stisknuté, zkontrolujte jeho vodiče."],
  119: ["je aktivní PAUSE: {}", "Uvolněte signál PAUSE, příčina: {}."],

  201: ["sběrnice {} je mimo provoz", "Zkontrolujte adaptér CAN sběrnice {}; otevře se znovu sám."],
  202: ["na sběrnici {} nikdo nepotvrzuje příjem", "Zkontrolujte kabel, zakončení a rychlost sběrnice {} a napájení pohonů."],
  203: ["pohony ovládá jiný program", "Ukončete druhý program, který ovládá pohony na sběrnici {}."],
  211: ["{} se spouští", WAIT],
  212: ["{} nelze spustit", "Podívejte se na chyby, zkontrolujte typ a napájení: {}."],
  213: ["{} neodpovídá nebo vypadl z provozu", "Zkontrolujte napájení a kabel: {}; spustí se znovu sám."],
  214: ["{} neodpovídá na dotazy", "Počkejte několik sekund: {} se spustí znovu sám."],
  215: ["{} sám změnil stav", AFTER_ERRORS],
  216: ["{} nepřechází do žádaného stavu", AFTER_ERRORS],
  217: ["{} nepřijímá žádanou hodnotu", AFTER_ERRORS],
  218: ["{} hlásí závadu", "Podívejte se na chyby: {}; závada se nuluje sama."],
  219: ["{} zatím nenahlásil svůj stav", WAIT],
  221: ["{} ještě nezná výchozí polohu", "Nechte ji najít; přední kola k tomu musí mít místo."],
  222: ["{} hledá výchozí polohu", "Počkejte několik sekund: dojede na spínač a pak srovná kola."],
  223: ["{} zná výchozí polohu a srovnává kola", WAIT],
  224: ["{} nemůže najít výchozí polohu", "Zkuste to znovu; přední kola k tomu musí mít místo."],
  225: ["{} má najít výchozí polohu: čeká na obsluhu", "Nepřibližujte se k předním kolům; pak nechte výchozí polohu najít, odešlete cíl nebo řiďte ručně od nuly."],
  231: ["{} nedrží své nastavení", "Zjistěte, kdo nastavení mění: {}; obnoví se samo."],
  232: ["robot jel rychleji, než měl", "Zjistěte příčinu; pak ručně spusťte modul driver_canbus (RUN)."],
  233: ["napájení motorů bylo odpojeno: robot nebrzdil, jak měl", "Zjistěte příčinu; pak ručně zapněte napájecí kanál motors."],
  234: ["druhý způsob zastavení neodpovídá", "Zkontrolujte, co odpojuje napájení motorů: napájení a kabel uzlu, nebo vodič GPIO."],
  235: ["napájení motorů je vypnuté", "Přesvědčte se, že se robot smí pohnout; pak ručně zapněte napájecí kanál motors."],
  236: ["údaje kol si odporují", "Zkontrolujte snímače otáček, kola a jejich pořadí na sběrnici; pak nejprve zadejte nulovou rychlost."],
  237: ["hnané kolo stálo, ačkoli se mělo otáčet", "Uvolněte robota, nebo zkontrolujte snímač otáček kola; pak ručně zadejte driver_canbus stav RUN."],

  301: ["neběží nezbytný modul {}", "Počkejte několik sekund: {} se spustí znovu sám. Pokud ne, podívejte se na moduly."],
  302: ["dohled nad moduly (watchdog) neodpovídá", "Počkejte několik sekund: spustí se znovu sám."],
  303: ["na sběrnici zpráv je další robot", "Vypněte druhého robota, nebo mu dejte vlastní sběrnici zpráv (--lcm-url)."],
  311: ["modul {} je ve stavu INIT", "Počkejte několik sekund; důvod je v chybách."],
  312: ["modul {} je ve stavu PAUSE", "Spusťte modul {} (RUN)."],
  313: ["modul {} je ve stavu STOP", "Spusťte modul {} ručně (RUN)."],
  314: ["modul {} je ve stavu ERROR", "Podívejte se na chyby modulu {}."],
  315: ["modul {} je ve stavu TERMINATE", "Spusťte modul {} (RUN)."],
  321: ["modul {} neodpovídá", "Podívejte se na moduly: {} musí běžet."],

  401: ["nikdo nezadává pohyb", "Řiďte ručně, nebo pošlete robota do cíle."],
  402: ["povel byl mimo povolené meze", "Podívejte se na chyby: je v nich zdroj a hodnota."],
  403: ["{} má nižší prioritu než ten, kdo řídí", "Počkejte, až druhý zdroj robota uvolní."],
  404: ["{} musí čekat: robotem hýbe jiný zdroj se stejnou prioritou", "Počkejte, až druhý zdroj robota uvolní."],
  405: ["{} musí nejprve poslat nulovou rychlost: robot byl zastaven", "Uvolněte ovládání a stiskněte je znovu."],
  406: ["{} čeká: obsluha musí zvolit Pokračovat", "Odešlete znovu cíl nebo režim, nebo zvolte Pokračovat."],
  407: ["robota řídí {}", "Počkejte, až {} robota uvolní, pak zvolte Pokračovat."],
  408: ["robot dokončuje zastavení", "Okamžik počkejte: do sekundy bude stát."],
  411: ["{} žádá pohyb do strany, který podvozek neumí", "Nic se neděje: {} smí zadávat jen rychlost vpřed a otáčení."],
  412: ["{} žádá otočení na místě, které podvozek neumí", "Nic se neděje: {} musí s otáčením zadat i rychlost vpřed."],
  413: ["{} žádá ostřejší zatáčku, než podvozek umí: zatáčí, jak nejvíc může", "Nic se neděje: {} musí zadat větší rychlost, nebo menší otáčení."],
  414: ["rychlost omezuje dráha, na které musí PAUSE robota zastavit", "Nic se neděje: zadejte nižší rychlost."],

  501: ["poloha zatím není určena", "Počkejte několik sekund; musí běžet modul estimator."],
  502: ["robot neví, kde je", "Zadejte polohu ručně, nebo robota přemístěte tam, odkud jsou vidět majáky."],
  503: ["robot hledá svou polohu", "Nezakrývejte majáky, tři musí být vidět; jinak zadejte polohu ručně."],
  504: ["údaj o poloze je starý nebo neplatný", "Podívejte se na moduly: musí běžet estimator."],
  505: ["sonary nic neposílají", "Podívejte se na moduly a sběrnice: desky dálkoměrů musí odpovídat."],
  506: ["o sonarech {} není nic známo", "Podívejte se na chyby: deska dálkoměrů {} musí odpovídat."],
  507: ["deska dálkoměrů {} neodpovídá", "Zkontrolujte napájení a kabel: {}. Až odpoví, uvolněte ovládání a stiskněte je znovu, nebo znovu odešlete cíl."],
  511: ["plánovač nesmí jet: neběží modul {}", "Počkejte několik sekund: {} se spustí znovu sám. Pak zvolte Pokračovat."],
  512: ["plánovač nezná polohu robota", "Počkejte, až bude poloha známa, pak zvolte Pokračovat."],

  601: ["není zadán cíl", "Pošlete robota do cíle."],
  602: ["plánovač se rozjíždí", "Okamžik počkejte."],
  603: ["plánovač hledá cestu", WAIT],
  604: ["v cestě někdo stojí, místo {}", "Uvolněte cestu; po chvíli robot zkusí jinou."],
  605: ["někdo stojí příliš blízko", "Ustupte; po chvíli robot zkusí jinou cestu."],
  606: ["plánovač couvá", WAIT],
  607: ["robot stojí v jediném bodě své smyčky", "Pošlete robota do jiného cíle."],
  608: ["režim ručně: robota řídí jen lidé", "Zvolte režim trasa, pak pošlete robota do cíle."],
  609: ["není nastaveno domovské místo", "Nastavte planner.home, nebo pošlete robota do cíle."],
  610: ["plánovač čeká na lidi", "Počkejte, až někdo přijde, nebo zvolte režim trasa."],
  611: ["k bodu {} není cesta: robot se v cíli nevejde", "Uvolněte místo, nebo pošlete robota jinam."],
  612: ["k bodu {} není cesta: robot stojí v překážce nebo mimo mapu", "Zkontrolujte polohu; vyjeďte s robotem ručně ven."],
  613: ["k bodu {} není cesta: žádná k cíli nevede", "Uvolněte průjezd, nebo pošlete robota jinam."],
  614: ["k bodu {} se v povoleném čase cesta nenašla", "Uvolněte průjezd, nebo tam robota pošlete po kratších úsecích."],
  615: ["k bodu {} není cesta: souřadnice není číslo", "Odešlete platný cíl."],
  616: ["k bodu {} není cesta: je příliš daleko", "Pošlete tam robota po kratších úsecích, nebo mu dejte mapu."],
  617: ["k bodu {} to nejde: robot měl jet a nejede", "Zkontrolujte, že kolům nic nebrání."],
  618: ["k bodu {} to nejde: robot zastavil vedle něj", "Počkejte několik sekund: robot to zkusí znovu."],
  619: ["k bodu {} není cesta: něco v ní stojí", FREE_THE_WAY],

  701: ["hlídač okolí neodpovídá", "Počkejte několik sekund: hlídač se spustí znovu sám."],
  711: ["v blízkosti něco je: {}", "Uvolněte prostor před snímačem: {}."],
  712: ["robot zpomaluje před tím, co je vpředu: {}", "Uvolněte prostor před snímačem: {}, nebo počkejte."],
  713: ["snímač {} nic neposílá: jeho prostor platí za obsazený", "Podívejte se na chyby: deska snímače {} musí odpovídat."],
  714: ["překážky v cestě nehlídá žádný snímač: robot jede pomalu", "Robot potřebuje snímače: tabulka guard v robot.toml."],
  715: ["hlídač okolí nezná pohyb robota", "Podívejte se na moduly: driver_canbus musí běžet."],
  716: ["hlídač okolí se na okamžik odmlčel", WAIT],
  717: ["hlídač okolí tímto směrem víc nedovolí", "Uvolněte prostor v tomto směru, nebo počkejte."],
  718: ["dál snímače nedosáhnou: robot jede jen tak rychle, aby v jejich dosahu zastavil", "Nic se neděje: zadejte nižší rychlost."],
  721: ["{} popojíždí kolem překážky", "Až bude cesta volná, pusťte druhé tlačítko."],
};

const STOPS: Readonly<Record<string, string>> = { sd1_front: "přední snímače podlahy", sd1_rear: "zadní snímače podlahy", button: "červené tlačítko", "": "neznámý zdroj" };
const DRIVES: Readonly<Record<string, string>> = { propulsion: "pohon pojezdu", steering: "pohon zatáčení" };

/** Who commands the motion: as on the bus, or as the robot has it in words (messages/src/source.rs). */
export function commander(name: string): string {
  const web = /^web:(.+)$/.exec(name)?.[1];
  if (web !== undefined) return `${web} (web)`;
  if (/^(diag:\d+|a terminal \(advee diag\))$/.test(name)) return "terminál (advee diag)";
  const tool = /^([a-z]+)@(.*):\d+$/.exec(name) ?? /^advee ([a-z]+)(?: on (.+))?$/.exec(name);
  if (tool) return `advee ${tool[1]}${tool[2] ? ` na počítači ${tool[2]}` : ""}`;
  return { planner: "plánovač", "": "nikdo" }[name] ?? name;
}

/** The subject as people call it. */
export function who({ code, subject }: Pick<HoldRow, "code" | "subject">): string {
  if (code === 103 || code === 114) return subject.replace(".", " ");
  if (code === 104 || code === 115) {
    return subject.replace(/^io\.(.+)$/, "vstup $1").replace(/^drive\.(.+)\.(\d+)$/, "vstup $2 pohonu $1");
  }
  if (code >= 111 && code <= 119) return STOPS[subject] ?? subject.replace(/^bumper ?(\d)$/, "nárazník $1");
  if ((code >= 211 && code <= 219) || code === 231) return DRIVES[subject] ?? `pohon ${subject}`;
  if (code >= 221 && code <= 225) return subject === "steering" ? "zatáčení" : `osa ${subject}`;
  if ((code >= 403 && code <= 413) || code === 721) return commander(subject);
  if (code === 506) return { front: "vpředu", rear: "vzadu" }[subject] ?? subject;
  if (code === 604) return place(subject);
  return subject;
}

/** `5.5, 5.7` */
export const place = (text: string): string => text.replace(/(-?\d+)\.(\d+), (-?\d+)\.(\d+)/, "$1,$2; $3,$4");

/** Both sentences about the subject; null: another version's number. */
export function hold(row: Pick<HoldRow, "code" | "subject">): { words: string; remedy: string; who: string } | null {
  const known = (HOLDS as Readonly<Record<number, readonly [string, string]>>)[row.code];
  if (known === undefined) return null;
  const name = who(row);
  const about = (text: string) => text.replaceAll("{}", name);
  return { words: about(known[0]), remedy: about(known[1]), who: name };
}
